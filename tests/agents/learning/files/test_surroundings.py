"""Surroundings of a session: whose commit is named."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from dohyo.agents.learning.files import surroundings


def git(folder: Path, *arguments: str) -> str:
    """Output of git in a folder."""
    who = ("-c", "user.name=a", "-c", "user.email=a@b", "-c", "commit.gpgsign=false")
    done = subprocess.run(["git", "-C", str(folder), *who, *arguments], capture_output=True, text=True, check=True)
    return done.stdout.strip()


def test_the_commit_of_a_repository_that_has_not_this_code_is_not_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As of a project with dohyo installed in its folder .venv."""
    installed = tmp_path / ".venv" / "surroundings.py"
    installed.parent.mkdir()
    installed.touch()
    (tmp_path / ".gitignore").write_text(".venv\n")
    git(tmp_path, "init")
    git(tmp_path, "add", ".gitignore")
    git(tmp_path, "commit", "-m", "theirs")
    monkeypatch.setattr(surroundings, "__file__", str(installed))
    facts = surroundings.surroundings()
    assert (facts["commit"], facts["uncommitted"]) == (None, False)
    git(tmp_path, "add", "-f", str(installed))
    git(tmp_path, "commit", "-m", "with a copy of this code")
    facts = surroundings.surroundings()
    assert (facts["commit"], facts["uncommitted"]) == (git(tmp_path, "rev-parse", "HEAD"), False)
