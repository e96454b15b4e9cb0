"""Running episodes: one process each, and the frames between it and the server."""
