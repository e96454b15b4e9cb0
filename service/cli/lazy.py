"""Commands that are imported when they run: the help and the lists must not wait for torch, SUMO or a database."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import wraps
from importlib import import_module
from typing import Any

import typer
from typer.core import TyperCommand, TyperGroup
from typer.main import get_command

INTERRUPTED = 130


@dataclass(frozen=True, slots=True)
class Command:
    """Where a command is, and what the help says of it.

    Attributes:
        at: "module:function", the module in this folder.
        help: The first line of the function's docstring.
        resumes: Run again, the same command goes on where it was stopped.
    """

    at: str
    help: str
    resumes: bool = False


@dataclass(frozen=True, slots=True)
class Group:
    """Commands that share their first word.

    Attributes:
        help: One line.
        commands: By their second word.
    """

    help: str
    commands: Mapping[str, Command]


class _PlainFlags:
    """Leaves the word <bool> out of the help of options that take no value."""

    def get_params(self, ctx: Any) -> list[Any]:
        """All parameters, as click asks for them."""
        params: list[Any] = super().get_params(ctx)  # type: ignore[misc]
        for param in params:
            if getattr(param, "is_flag", False) and param.metavar is None:
                param.metavar = ""
        return params


class CommandGroup(_PlainFlags, TyperGroup):
    """Commands that share their first word."""


class PlainCommand(_PlainFlags, TyperCommand):
    """One command."""


class LazyCommand(TyperCommand):
    """A line of the help; becomes the command itself when its arguments are parsed."""

    def __init__(self, name: str, command: Command) -> None:
        super().__init__(name, help=command.help)
        self.command = command

    def make_context(self, *arguments: Any, **options: Any) -> Any:
        """Imports the command, and parses its arguments."""
        return self.load().make_context(*arguments, **options)

    def load(self) -> Any:
        """The command itself, with its parameters."""
        module, _, function = self.command.at.partition(":")
        app = typer.Typer(add_completion=False)
        found = getattr(import_module(f"dohyo.service.cli.{module}"), function)
        app.command(self.name, cls=PlainCommand)(_interruptible(found, self.command.resumes))
        return get_command(app)


def make_commands(table: Mapping[str, Command | Group]) -> dict[str, Any]:
    """What a group of commands is made of, by name."""
    return {
        name: LazyCommand(name, entry)
        if isinstance(entry, Command)
        else CommandGroup(name=name, help=entry.help, no_args_is_help=True, commands=make_commands(entry.commands))
        for name, entry in table.items()
    }


def _interruptible(function: Callable[..., None], resumes: bool) -> Callable[..., None]:
    """The same function, but Ctrl-C ends it in one line."""

    @wraps(function)
    def run(*arguments: Any, **options: Any) -> None:
        try:
            function(*arguments, **options)
        except KeyboardInterrupt as error:
            further = "; the same command goes on where this one stopped" if resumes else ""
            print(f"dohyo: interrupted{further}", file=sys.stderr)
            raise typer.Exit(INTERRUPTED) from error

    return run
