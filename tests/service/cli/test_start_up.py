"""What `dohyo` imports before it answers, and what its help says."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Iterator, Mapping
from importlib import import_module
from importlib.metadata import version
from pathlib import Path

import pytest

from dohyo.service.cli.command_table import COMMANDS
from dohyo.service.cli.commands import benchmark_list
from dohyo.service.cli.lazy import Command, Group, LazyCommand

ROOT = Path(__file__).parents[3]
SLOW = ("torch", "scipy", "sqlalchemy", "libsumo", "numba")
REPORT = f"""
import atexit, sys
atexit.register(lambda: print("imported:", *({SLOW!r} & sys.modules.keys()), file=sys.stderr))
from dohyo.service.cli import main
main()
""".replace(repr(SLOW), repr(set(SLOW)))


def dohyo(*arguments: str, cwd: Path, code: str = REPORT) -> subprocess.CompletedProcess[str]:
    environment = os.environ | {"PYTHONPATH": str(ROOT), "COLUMNS": "160"}
    command = [sys.executable, "-c", code, *arguments]
    return subprocess.run(command, cwd=cwd, capture_output=True, text=True, timeout=300, env=environment, check=False)


def leaves(table: Mapping[str, Command | Group], words: tuple[str, ...] = ()) -> Iterator[tuple[str, Command]]:
    for name, entry in table.items():
        if isinstance(entry, Command):
            yield " ".join((*words, name)), entry
        else:
            yield from leaves(entry.commands, (*words, name))


@pytest.mark.parametrize("arguments", [("--help",), ("networks", "list"), ("agents", "list"), ("benchmarks", "list")])
def test_the_help_and_the_tables_do_without_numpy_and_models(arguments: tuple[str, ...], tmp_path: Path) -> None:
    code = f"{REPORT.replace(repr(set(SLOW)), repr({'numpy', 'gymnasium', 'dohyo.sumo_networks.events'}))}"
    assert dohyo(*arguments, cwd=tmp_path, code=code).stderr.strip() == "imported:"


@pytest.mark.parametrize(
    "arguments",
    [
        ("--help",),
        ("--version",),
        ("networks", "--help"),
        ("networks", "list"),
        ("agents", "list"),
        ("benchmarks", "list"),
        ("benchmarks", "list", "--json"),
        ("train", "--list"),
    ],
    ids=" ".join,
)
def test_the_help_and_the_lists_import_nothing_slow(arguments: tuple[str, ...], tmp_path: Path) -> None:
    result = dohyo(*arguments, cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert result.stderr.strip() == "imported:"


def test_the_table_of_benchmarks_says_what_the_loaded_ones_say() -> None:
    loaded = [
        (row["name"], str(row["scenarios"]), row["headline"], row["description"])
        for row in benchmark_list._with_versions()
    ]
    assert loaded == benchmark_list.table_rows()[:-1]


def test_a_command_that_reads_a_network_imports_numba(tmp_path: Path) -> None:
    # What makes the test above able to fail.
    assert "numba" in dohyo("networks", "check", "ingolstadt", cwd=tmp_path).stderr.split()


@pytest.mark.parametrize(
    ("words", "command"), list(leaves(COMMANDS)), ids=lambda given: str(given) * isinstance(given, str)
)
def test_every_command_is_where_the_table_says_and_says_the_same(words: str, command: Command) -> None:
    module, _, function = command.at.partition(":")
    found = getattr(import_module(f"dohyo.service.cli.commands.{module}"), function)
    assert " ".join((found.__doc__ or "").partition("\n\n")[0].split()) == command.help


@pytest.mark.parametrize(
    ("words", "command"), list(leaves(COMMANDS)), ids=lambda given: str(given) * isinstance(given, str)
)
def test_no_help_text_has_a_bracket_that_rich_takes_for_markup_and_leaves_out(words: str, command: Command) -> None:
    texts = [getattr(one, "help", None) or "" for one in LazyCommand(words, command).load().params]
    assert [text for text in texts if re.search(r"\[[a-z#/@]", text)] == []


def test_the_version_is_the_packages(tmp_path: Path) -> None:
    assert dohyo("--version", cwd=tmp_path).stdout == f"dohyo {version('dohyo')}\n"


def test_options_without_a_value_are_shown_without_one(tmp_path: Path) -> None:
    shown = dohyo("agents", "list", "--help", cwd=tmp_path).stdout
    assert "--json" in shown
    assert "bool" not in shown


def test_the_shell_completes_commands_and_options(tmp_path: Path) -> None:
    environment = {"_DOHYO_COMPLETE": "complete_bash", "COMP_WORDS": "dohyo networks ch", "COMP_CWORD": "2"}
    program = "import sys; sys.argv[0] = 'dohyo'; from dohyo.service.cli import main; main()"
    result = subprocess.run(
        [sys.executable, "-c", program],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=300,
        env=os.environ | environment | {"PYTHONPATH": str(ROOT)},
        check=False,
    )
    assert result.stdout.split() == ["check"]
