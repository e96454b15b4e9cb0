"""Benchmarks of the freeway: their definition, results and page."""
