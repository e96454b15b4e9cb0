"""Study of RLAD: its parts, its rivals, its encoder's size."""

STUDIES = {"rlad": "study"}
