"""The service's clients: REST for people and programs, the wire for policy workers."""
