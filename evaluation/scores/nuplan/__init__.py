"""nuPlan's closed-loop score."""
