"""Training of PRIBOOT's waypoints on recorded demonstrations."""
