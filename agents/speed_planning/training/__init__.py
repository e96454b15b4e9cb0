"""Training of the learned parts, in their macroscopic and microscopic worlds."""
