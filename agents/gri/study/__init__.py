"""Study of GRI: its arms, trainings, judgements and tables."""

STUDIES = {"gri": "study", "griad": "states", "griad-pictures": "pictures"}
