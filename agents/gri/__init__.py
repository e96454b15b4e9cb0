"""GRI: demonstrations and exploration in one replay, whose learner does not know which is which."""
