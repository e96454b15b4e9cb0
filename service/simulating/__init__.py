"""The process of a world, and what it and the server tell each other."""
