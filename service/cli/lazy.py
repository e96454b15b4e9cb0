"""Commands that are imported only when they run: help and lists must not wait for torch, SUMO or a database."""

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
    """Location of a command, and its help.

    Attributes:
        at: "module:function", the module in this folder.
        help: The first line of the function's docstring.
        resumes: Whether the command, run again, continues where it stopped.
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
    """Omits <bool> from the help of options without a value."""

    def get_params(self, ctx: Any) -> list[Any]:
        """Parameters for click."""
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
    """Help line of a command; loads the command when its arguments are parsed."""

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
        found = getattr(import_module(f"dohyo.service.cli.commands.{module}"), function)
        app.command(self.name, cls=PlainCommand)(_interruptible(found, self.command.resumes))
        return get_command(app)


def make_commands(table: Mapping[str, Command | Group]) -> dict[str, Any]:
    """Click commands of a group, by name."""
    return {
        name: LazyCommand(name, entry)
        if isinstance(entry, Command)
        else CommandGroup(name=name, help=entry.help, no_args_is_help=True, commands=make_commands(entry.commands))
        for name, entry in table.items()
    }


def _interruptible(function: Callable[..., None], resumes: bool) -> Callable[..., None]:
    """The function, with one line on standard error after Ctrl-C."""

    @wraps(function)
    def run(*arguments: Any, **options: Any) -> None:
        try:
            function(*arguments, **options)
        except KeyboardInterrupt as error:
            further = "; the same command goes on where this one stopped" if resumes else ""
            print(f"dohyo: interrupted{further}", file=sys.stderr)
            raise typer.Exit(INTERRUPTED) from error

    return run
