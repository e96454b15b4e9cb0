"""Networks of policies and critics, distributions of actions, moments of observations."""
