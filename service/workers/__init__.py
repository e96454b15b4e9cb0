"""Policy workers: registered, leased episodes, stepped in lockstep."""
