"""The study of MBAPPE: arms, measures of a drive, tables, and the time of a decision."""

STUDIES = {"mbappe": "study"}
