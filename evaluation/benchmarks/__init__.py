"""The benchmarks, one TOML file each, and how the missions of those on our towns were drawn."""
