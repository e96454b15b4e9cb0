"""Trained policies: exported, loaded again, and as driving agents."""
