"""GRIAD's driving task: its choices, what it sees, its reward, and the episodes."""
