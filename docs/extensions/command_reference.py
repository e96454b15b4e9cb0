"""The directive `command-reference`: every command of `dohyo` with its options, read from the program itself."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import typer
from docutils import nodes
from docutils.statemachine import StringList
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

from dohyo.service.cli import app as program
from dohyo.service.cli.lazy import LazyCommand


def commands(command: Any, words: tuple[str, ...]) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Every command with the words that call it, groups opened and lazy commands loaded."""
    command = command.load() if isinstance(command, LazyCommand) else command
    below = getattr(command, "commands", None)
    if below is None:
        yield words, command
        return
    for name, one in below.items():
        yield from commands(one, (*words, name))


def described(words: tuple[str, ...], command: Any) -> Iterator[str]:
    """One command as lines of Markdown."""
    yield from ("", f"## {' '.join(words)}", "", (command.help or "").strip(), "")
    yield from ("| option | | default |", "|---|---|---|")
    for parameter in command.params:
        is_option = parameter.param_type_name == "option"
        name = ", ".join(parameter.opts) if is_option else (parameter.metavar or parameter.name).upper()
        yield f"| `{name}` | {cell(parameter.help)} | {default(parameter)} |"


def default(parameter: Any) -> str:
    """What holds where the option is left out."""
    if parameter.required:
        return "required"
    value = parameter.default
    if value is None or value == "" or callable(value) or isinstance(value, bool):
        return ""
    return f"`{getattr(value, 'value', value)}`"


def cell(words: str | None) -> str:
    """Words that a table can hold."""
    return " ".join((words or "").split()).replace("|", "\\|")


class CommandReference(SphinxDirective):
    """A section for each command."""

    def run(self) -> list[nodes.Node]:
        """The sections, parsed by the parser of the page."""
        found = commands(typer.main.get_command(program), ("dohyo",))
        lines = [line for words, command in found for line in described(words, command)]
        text = "\n".join(lines).splitlines()
        return self.parse_content_to_nodes_of(text)

    def parse_content_to_nodes_of(self, lines: list[str]) -> list[nodes.Node]:
        """Nodes of Markdown lines, headings allowed."""
        self.content = StringList(lines, source="dohyo --help")
        return self.parse_content_to_nodes(allow_section_headings=True)


def setup(app: Sphinx) -> dict[str, Any]:
    """Registers the directive."""
    app.add_directive("command-reference", CommandReference)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
