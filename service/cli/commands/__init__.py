"""The commands of `dohyo`, one module each."""
