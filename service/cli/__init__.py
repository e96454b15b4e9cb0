"""The command line: `dohyo`. One file per group of commands."""

from dohyo.service.cli.main import app, main

__all__ = ["app", "main"]
