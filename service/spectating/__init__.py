"""Spectators of live worlds: scenes ten times a second, and the replay of a world that has ended."""
