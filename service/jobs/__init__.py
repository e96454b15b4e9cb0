"""Jobs: heavy work in a queue, run a few at once in fair turns between owners."""
