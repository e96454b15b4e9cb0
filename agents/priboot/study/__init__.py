"""The study of PRIBOOT: arms, measures of a drive, tables."""
