"""Parking lots as episodes: agents that park, of all three kinds of submission."""
