"""What planners share: the scene they plan in, the predictors' interface, and the path and box kernels."""
