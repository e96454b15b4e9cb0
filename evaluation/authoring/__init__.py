"""Scripts that draw the benchmarks; their output is committed in `benchmarks/`."""
