"""Networks: what reads a history, how it looks ahead, and both by name."""
