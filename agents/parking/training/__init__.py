"""Training of parking: the task, its curriculum, features, and the trainer of DPPO-IL."""
