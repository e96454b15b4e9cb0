"""The study of all learned drivers: how much of what they learned holds where they never were."""

STUDIES = {"generalisation": "generalisation"}
"""Studies by name."""
