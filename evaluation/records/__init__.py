"""Records: the facts and trajectories of an episode, and how they are stored."""
