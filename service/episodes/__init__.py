"""Live episodes: one process each, leases of policy workers, the scheduler."""
