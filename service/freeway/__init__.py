"""Freeway mornings as episodes: a policy worker plans the speeds of connected cars."""
