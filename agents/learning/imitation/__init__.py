"""Imitation: learners of an expert's actions, and a reward for resembling the expert."""
