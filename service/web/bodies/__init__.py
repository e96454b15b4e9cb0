"""Bodies of requests: strict JSON, the routes that read it, uploads."""
