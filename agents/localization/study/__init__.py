"""The studies of filters: synthetic journeys, the arms of row 21 with their claims, tables, figures."""

STUDIES = {"localization": "study"}
"""Studies by name."""
