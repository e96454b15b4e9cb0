"""The study of PDM-Hybrid: plans against what was driven, and drives, of planners with and without a learned part."""

STUDIES = {"pdm-hybrid": "study"}
"""Studies by name."""
