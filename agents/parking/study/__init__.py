"""Study of parking: arms, their judgement, tables."""

STUDIES = {"parking": "study"}
