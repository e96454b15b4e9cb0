"""One episode: the loop of observing, acting and judging."""
