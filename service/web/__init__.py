"""What all routes share: limits, uploads, caching, description."""
