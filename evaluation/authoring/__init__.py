"""Scripts that draw the missions of benchmarks; their output is committed in `benchmarks/`."""
