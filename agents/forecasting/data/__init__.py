"""Tables of speeds: reading, gaps, scale, and windows of rows."""
