"""The benchmarks, one TOML file each, and the code that makes scenarios of them."""
