"""Evaluations of one agent on one benchmark: executors, resumption, locks."""
