"""Training: the loop that learners share, and PPO."""
