"""Benchmarks of parking: definitions, agents, drives, records, results and page."""
