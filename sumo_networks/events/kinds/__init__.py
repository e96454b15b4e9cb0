"""The kinds of events: each with its numbers, its placement and its behaviour; a file per family of kinds."""
