"""The world: SUMO road networks wrapped as a multi-agent environment."""
