"""Study of GRI: its arms, trainings, judgements and tables."""
