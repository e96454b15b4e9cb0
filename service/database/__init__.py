"""The database: tables, the engine, and queries as small functions that take a session."""
