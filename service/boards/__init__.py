"""Leaderboards and comparisons of finished evaluations."""
