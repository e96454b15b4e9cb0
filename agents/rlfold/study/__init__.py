"""Study of RLfOLD: its parts, and the quality of its expert."""

STUDIES = {"rlfold": "study"}
