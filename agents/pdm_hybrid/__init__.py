"""PDM-Hybrid: PDM-Closed's plan, and beyond its first two seconds a learned offset to it."""
