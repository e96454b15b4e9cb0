"""The root command, and the output of errors."""

from __future__ import annotations

import sys
from importlib.metadata import version
from typing import Annotated, Any

import typer

from dohyo.service.cli.command_table import COMMANDS
from dohyo.service.cli.lazy import INTERRUPTED, CommandGroup, make_commands
from dohyo.sumo_networks.errors import DohyoError

BAD_INPUT = 2


class Root(CommandGroup):
    """Root command `dohyo` with all commands of `commands.COMMANDS`."""

    def __init__(self, **given: Any) -> None:
        super().__init__(**given)
        self.commands.update(make_commands(COMMANDS))


app = typer.Typer(name="dohyo", cls=Root, no_args_is_help=True, pretty_exceptions_enable=False)


def _print_version(wanted: bool) -> None:
    if wanted:
        print(f"dohyo {version('dohyo')}")
        raise typer.Exit


@app.callback()
def root(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    """Evaluates driving agents in SUMO traffic: real city networks, reproducible scores."""


def main() -> None:
    """Runs the command line; a DohyoError becomes one line on standard error and exit code 2."""
    try:
        app()
    except DohyoError as error:
        from dohyo.service.cli.output import plain

        print(f"dohyo: {plain(str(error))}", file=sys.stderr)
        sys.exit(BAD_INPUT)
    except KeyboardInterrupt:
        sys.exit(INTERRUPTED)
