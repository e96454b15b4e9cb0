"""League: dohyo's systems compared on parts of benchmarks, on seeds that were fixed before the first drive."""
