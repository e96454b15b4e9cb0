"""Processes that start with their libraries loaded: copies of one that has loaded them."""
