"""What the service remembers: tables, the engine, and queries as small functions that take a session."""
