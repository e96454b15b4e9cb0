"""Evaluations: ordered, listed, cancelled, summarised and rescored."""
