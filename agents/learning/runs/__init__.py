"""Runs: one training from the first step to the last, over any number of sessions."""
