"""The speed planner, the connected vehicles' controllers, and what they do to all traffic."""
