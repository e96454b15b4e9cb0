"""Freeway mornings with a policy worker as planner."""
