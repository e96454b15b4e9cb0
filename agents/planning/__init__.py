"""Shared by planners: the scene, the predictors' interface, and the path and box kernels."""
