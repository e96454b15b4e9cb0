"""The layout: tests/ mirrors the four floors, and no folder is a drawer."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FLOORS = ("sumo_networks", "evaluation", "agents", "service")
MODULES_AT_MOST = 15
OF_ONE_KIND = {"sumo_networks/sensors", "sumo_networks/events/kinds", "service/cli/commands"}
"""Folders that hold one module per sensor, per kind of event, or per command."""


def folders(root: Path) -> list[Path]:
    """A folder and all below it that hold modules."""
    return [root, *(path for path in sorted(root.rglob("*")) if path.is_dir() and any(path.glob("*.py")))]


@pytest.mark.parametrize("floor", FLOORS)
def test_every_folder_of_tests_has_the_package_that_it_tests(floor: str) -> None:
    for folder in folders(ROOT / "tests" / floor):
        package = ROOT / folder.relative_to(ROOT / "tests")
        assert (package / "__init__.py").is_file(), f"{folder.relative_to(ROOT)} tests no package"


@pytest.mark.parametrize("floor", FLOORS)
def test_no_folder_is_a_drawer(floor: str) -> None:
    for folder in folders(ROOT / floor):
        modules = [path for path in folder.glob("*.py") if path.name != "__init__.py"]
        name = str(folder.relative_to(ROOT))
        assert name in OF_ONE_KIND or len(modules) <= MODULES_AT_MOST, f"{name} has {len(modules)} modules"


def test_every_package_says_what_it_is() -> None:
    for floor in FLOORS:
        for folder in folders(ROOT / floor):
            module = ast.parse((folder / "__init__.py").read_text())
            assert len(ast.get_docstring(module) or "") > 10, f"{folder.relative_to(ROOT)}/__init__.py"


@pytest.mark.parametrize(("floor", "upper"), [(floor, FLOORS[i + 1 :]) for i, floor in enumerate(FLOORS[:-1])])
def test_no_lower_floor_names_an_upper_one_not_even_in_a_string(floor: str, upper: tuple[str, ...]) -> None:
    """Import-linter sees imports alone; a name in a string is loaded just as well."""
    named = re.compile(rf"\bdohyo\.({'|'.join(upper)})\.")
    for path in sorted((ROOT / floor).rglob("*.py")):
        found = [
            f"{path.relative_to(ROOT)}:{number}"
            for number, line in enumerate(path.read_text().splitlines(), 1)
            if named.search(line)
        ]
        assert not found
