"""Starts: the state in which a filter begins, standing or rolling."""
