"""Study of GRI: its arms, trainings, judgements and tables."""

STUDIES = {"gri": "study", "griad": "unseen", "griad-pictures": "pictures"}
