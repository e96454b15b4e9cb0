"""Endless driving in town by target speed and steering: the task that RLAD and RLfOLD learn."""
