"""Environments: a scenario for one agent loop, several scenarios at once, and their rewards."""
