"""Experience: behaviours, the collector, the replay, demonstrations."""
