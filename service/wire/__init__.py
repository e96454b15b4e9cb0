"""The wire of policy workers: its messages and their description."""
