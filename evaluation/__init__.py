"""What an agent is, what counts as an infraction, scores, benchmarks, the runner and reports."""
