"""A world with a process, in memory: its seats and guests, its pace, and what its process shows."""
