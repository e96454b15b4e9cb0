"""The traffic around the egos: a constant population, flows beside it, and jaywalkers."""
