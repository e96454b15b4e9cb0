"""The policies, and their training."""
