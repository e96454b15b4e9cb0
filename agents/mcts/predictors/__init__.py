"""Predictors, the motion dataset they learn from, and their training."""
