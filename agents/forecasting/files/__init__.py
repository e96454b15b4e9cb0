"""Files of forecasters: loading one for a road or a table."""
