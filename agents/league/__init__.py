"""League: every system on every road under one metric, on seeds that nobody tuned on."""
