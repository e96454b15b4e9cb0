"""Study of parking: arms, their judgement, tables."""
