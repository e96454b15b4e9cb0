"""Training: tasks of the sub-policies, and option-critic for the master."""
