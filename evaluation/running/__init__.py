"""One agent on one benchmark: executors, resumption, locks."""
