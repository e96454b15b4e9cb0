"""An installed package of another lab; two of its agents cannot be described."""

from __future__ import annotations

from pathlib import Path

import pytest

_MODULE = """
from dohyo.evaluation.agent import Agent, AgentSpec

class Open(Agent):
    spec = AgentSpec(name="open", track="sensors", sensors=("speedometer",), control="lane_command")

    def __init__(self, weights: str) -> None:
        raise AssertionError("it is listed without being made")

class Closed(Agent):
    def __init__(self, weights: str) -> None:
        self.spec = Open.spec
"""
_ENTRIES = """
[dohyo.agents]
lab-closed = lab_of_tests:Closed
lab-gone = lab_that_was_removed:Driver
lab-open = lab_of_tests:Open
"""


def install_lab(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Installs the package `old-lab`: `lab-open` needs settings, `lab-closed` too, and `lab-gone` has no module."""
    facts = folder / "old_lab-1.0.dist-info"
    facts.mkdir()
    (facts / "METADATA").write_text("Metadata-Version: 2.1\nName: old-lab\nVersion: 1.0\n")
    (facts / "entry_points.txt").write_text(_ENTRIES)
    (folder / "lab_of_tests.py").write_text(_MODULE)
    monkeypatch.syspath_prepend(str(folder))
