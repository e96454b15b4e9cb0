"""Answer-set rules: the rulebook, its solver, facts from observations, and an agent that drives by them."""
