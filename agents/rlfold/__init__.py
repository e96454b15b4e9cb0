"""RLfOLD: reinforcement learning from online demonstrations, with two deviations and an uncertainty gate."""
