"""Options: the five manoeuvres, how one is run, and what its numbers do to the vehicle."""
