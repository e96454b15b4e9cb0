"""Mixed runs: scores by agent, and all agents of a benchmark beside each other."""
