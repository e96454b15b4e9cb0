"""Rivals of RLAD on the same task and loop: SAC+AE, CURL, DrQ, DrQ-v2."""
