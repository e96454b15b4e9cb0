"""Studies: arms, trainings, drives, held-out exercises, and their tables."""

STUDIES = {"ghrl": "study", "ghrl-policies": "evaluate_policies", "ghrl-trainings": "trainings"}
