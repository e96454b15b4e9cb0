"""Benchmarks of the freeway: definitions, results and page."""
