"""Benchmarks that the service evaluates."""
