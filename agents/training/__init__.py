"""The training ground: what every learner here shares, and PPO on it."""
