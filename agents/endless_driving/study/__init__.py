"""Study of drivers that learn by endless driving: arms, judgement in the unseen town, tables."""
