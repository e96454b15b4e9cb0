"""The study of PRIBOOT: arms, measures of a drive, tables."""

STUDIES = {"priboot": "study"}
