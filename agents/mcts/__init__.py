"""MBAPPE: Monte-Carlo tree search with a prior over an explicit inner simulator, and its baselines."""
