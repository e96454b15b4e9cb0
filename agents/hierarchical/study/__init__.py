"""Studies: arms, trainings, drives, held-out exercises, and their tables."""
