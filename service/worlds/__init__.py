"""Worlds: live scenarios that several workers join, each with its own egos."""
