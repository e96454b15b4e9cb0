"""The recipes of CONTRIBUTING.md, followed to the letter in a copy of the tree."""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
# Other processes may be writing compiled modules and kernels into the tree.
UNFINISHED = shutil.ignore_patterns("*.pyc*", "*.tmp.*")
COPIED = ("dohyo", "sumo_networks", "evaluation", "tests", "pyproject.toml", "CONTEXT.md")
LINKED = ("agents", "service")
BLOCK = re.compile(r"(?:^[^`\n]*`([^`\n]+)`:\n\n)?^```(\w+)\n(.*?)^```", re.MULTILINE | re.DOTALL)
IMPORTS_ARE_ANY = ("--follow-imports=skip", "--allow-subclassing-any", "--no-warn-return-any")
FILES_AT_MOST = {"network": 2, "benchmark": 2, "sensor": 3, "event kind": 3, "criterion": 4}
"""Files that a recipe makes or changes, its test included."""


@dataclass(frozen=True)
class Block:
    """A code block of a recipe: a whole file, a change of one as a diff, or commands."""

    path: str
    language: str
    body: str

    def apply(self, root: Path) -> None:
        """Writes the file, or changes it; the lines around the change must be there once."""
        target = root / self.path
        if self.language != "diff":
            assert not target.exists(), f"{self.path} is there already"
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_text(self.body)
            return
        lines = self.body.splitlines(keepends=True)
        before = "".join(line[1:] or "\n" for line in lines if line[0] in " -\n")
        after = "".join(line[1:] or "\n" for line in lines if line[0] in " +\n")
        source = target.read_text()
        assert source.count(before) == 1, f"{self.path}: expected these lines once:\n{before}"
        target.write_text(source.replace(before, after))


def recipe(thing: str) -> list[Block]:
    """The blocks below "## Add a THING"; one without a path belongs to the path before it."""
    document = (ROOT / "CONTRIBUTING.md").read_text()
    _, found, rest = document.partition(f"\n## Add a{'n' if thing[0] in 'aeiou' else ''} {thing}\n")
    assert found, f"CONTRIBUTING.md has no recipe for a {thing}"
    blocks: list[Block] = []
    for path, language, body in BLOCK.findall(rest.partition("\n## ")[0]):
        blocks.append(Block(path or blocks[-1].path, language, body))
    return blocks


def copy_tree(target: Path) -> None:
    """What a recipe may change, copied with its times, so that compiled kernels are found; the rest as links."""
    for name in COPIED:
        if (ROOT / name).is_dir():
            shutil.copytree(ROOT / name, target / name, symlinks=True, ignore=UNFINISHED)
        else:
            shutil.copy2(ROOT / name, target / name)
    for name in LINKED:
        (target / name).symlink_to(ROOT / name)


def run(root: Path, *command: str) -> None:
    environment = os.environ | {"PYTHONPATH": str(root), "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"}
    done = subprocess.run(
        [sys.executable, "-m", *command], cwd=root, capture_output=True, text=True, env=environment, check=False
    )
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-2000:]


@pytest.mark.slow
def test_the_recipes_give_what_they_say(tmp_path: Path) -> None:
    """All in one copy, as in a tree to which all five were added."""
    copy_tree(tmp_path)
    written, commands = set[str](), list[str]()
    for thing, most in FILES_AT_MOST.items():
        *blocks, last = recipe(thing)
        if last.language == "sh":
            commands += last.body.splitlines()
        else:
            blocks.append(last)
        touched = {block.path for block in blocks}
        assert len(touched) <= most, (thing, touched)
        for block in blocks:
            block.apply(tmp_path)
        assert any(is_test(path) for path in touched) or last.language == "sh", f"the recipe of a {thing} has a test"
        written |= touched
    modules = sorted(path for path in written if path.endswith(".py"))
    run(tmp_path, "ruff", "check", *modules)
    run(tmp_path, "ruff", "format", "--check", *modules)
    # Without the types of what they import, which take half a minute: those are Any here.
    checked = [path for path in modules if not path.startswith("tests/")]
    named = [f"--module=dohyo.{path.removesuffix('.py').replace('/', '.')}" for path in checked]
    run(tmp_path, "mypy", *IMPORTS_ARE_ANY, f"--cache-dir={os.devnull}", *named)
    for command in [f"pytest -q {' '.join(filter(is_test, modules))}", *commands]:
        run(tmp_path, *shlex.split(command), "-p", "no:cacheprovider")


def is_test(path: str) -> bool:
    return Path(path).name.startswith("test_")
