"""Speed planner, controllers of connected vehicles, and their effect on all traffic."""
