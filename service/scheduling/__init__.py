"""Scheduling: which episode drives next, and what becomes of it."""
