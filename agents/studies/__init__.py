"""Studies: arms, seeds and scenarios; claims with their intervals; tables and figures from stored rows."""
