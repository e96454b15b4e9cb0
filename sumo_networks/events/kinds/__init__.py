"""The kinds of events: one file per family, with configuration, placement and behaviour."""
