"""Studies across systems: learned drivers where they never were; planners on excerpts they were not developed on."""

STUDIES = {"generalisation": "generalisation", "planners": "planners"}
"""Studies by name."""
