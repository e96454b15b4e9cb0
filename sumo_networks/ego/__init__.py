"""The ego vehicles: their dynamics, the control interfaces, and their states on route and lanes."""
