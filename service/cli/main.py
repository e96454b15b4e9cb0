"""The root command, and the output of errors."""

from __future__ import annotations

import errno
import io
import sys
from importlib.metadata import version
from typing import Annotated, Any, NoReturn

import typer

from dohyo.service.cli.command_table import COMMANDS
from dohyo.service.cli.lazy import INTERRUPTED, CommandGroup, make_commands
from dohyo.sumo_networks.errors import DohyoError

BAD_INPUT = 2
UNWRITABLE = frozenset((errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS))


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
    """Runs the command line; bad input and unusable files become one line on standard error and exit code 2."""
    _print_everything()
    try:
        app()
    except DohyoError as error:
        _refuse(str(error))
    except OSError as error:
        if (reason := _file_fault(error)) is None:
            raise
        _refuse(reason)
    except KeyboardInterrupt:
        sys.exit(INTERRUPTED)


def _print_everything() -> None:
    """Escapes characters that standard output cannot encode, such as an umlaut in ASCII."""
    if isinstance(sys.stdout, io.TextIOWrapper) and sys.stdout.errors == "strict":
        sys.stdout.reconfigure(errors="backslashreplace")


def _refuse(reason: str) -> NoReturn:
    from dohyo.service.cli.output import print_error

    print_error(reason)
    sys.exit(BAD_INPUT)


def _file_fault(error: OSError) -> str | None:
    """Sentence about the file that cannot be used; None if the error is about no file, such as a closed pipe."""
    file = error.filename2 or error.filename
    if file is None and error.errno not in UNWRITABLE:
        return None
    verb = "write" if error.errno in UNWRITABLE else "use"
    return f"cannot {verb}: {error.strerror}" if file is None else f"cannot {verb} '{file}': {error.strerror}"
