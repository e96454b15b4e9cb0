"""Learning: what every learner shares: environments, replay, algorithms, runs and their files."""
