"""Sources: an edit anywhere in what an agent is made of makes it another agent; one elsewhere does not."""

from __future__ import annotations

import hashlib
import importlib
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from dohyo.evaluation.agent import agent_info, make_agent
from dohyo.evaluation.sources import source_files
from dohyo.sumo_networks.errors import InvalidInputError

FILES = {
    "__init__.py": '"""A team\'s agents."""\n',
    "planner/__init__.py": "",
    "planner/driver.py": """
from __future__ import annotations
import numpy as np
from dohyo.evaluation.agent import Agent, AgentSpec
from team.planner import costs
from .tree import grow
from ..shared.units import KMH

class Driver(Agent):
    def __init__(self):
        self.spec = AgentSpec(name="driver")
    def reset(self, mission, seed):
        from team.planner.late import warm
    def act(self, observation):
        return np.zeros(2, dtype=np.float32)
""",
    "planner/costs.py": "import team.shared.tables as tables\n",
    "planner/tree.py": "from team.planner import costs, driver\n\ndef grow(): ...\n",
    "planner/late.py": "warm, later = 1, 'team.planner.named:Named'\n",
    "planner/named.py": "class Named: ...\n",
    "planner/unused.py": "x = 1\n",
    "shared/__init__.py": "KMH = 3.6\n",
    "shared/units.py": "KMH = 3.6\n",
    "shared/tables.py": "TABLE = ()\n",
}
REACHED = {
    "planner/driver.py",
    "planner/costs.py",
    "planner/tree.py",
    "planner/late.py",
    "planner/named.py",
    "shared/__init__.py",
    "shared/units.py",
    "shared/tables.py",
}
ENTRY = "team.planner.driver:Driver"


@pytest.fixture
def team(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A package of agents on disk."""
    for name, text in FILES.items():
        path = tmp_path / "team" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    monkeypatch.syspath_prepend(str(tmp_path))
    importlib.invalidate_caches()
    yield tmp_path / "team"
    for name in [name for name in sys.modules if name.split(".")[0] == "team"]:
        del sys.modules[name]


def fingerprint() -> str:
    return agent_info(make_agent(ENTRY), ENTRY).source_sha256


def test_an_agent_is_its_file_and_those_it_reaches_in_its_package(team: Path) -> None:
    files = source_files(type(make_agent(ENTRY)))
    assert files[0] == team / "planner" / "driver.py"
    assert {str(path.relative_to(team)) for path in files} == REACHED
    assert len(files) == len(REACHED)
    assert files == source_files(type(make_agent(ENTRY)))
    assert "team.planner.late" not in sys.modules, "nothing is executed to find out"


@pytest.mark.parametrize("name", sorted(FILES))
def test_an_edit_counts_where_it_decides_something(team: Path, name: str) -> None:
    before = fingerprint()
    with (team / name).open("a") as file:
        file.write("\n# a change of heart\nMARGIN = 0.9\n")
    # What was an empty package has code of its own now.
    assert (fingerprint() != before) == (name != "planner/unused.py")


def test_a_new_module_behind_an_import_counts(team: Path) -> None:
    before = fingerprint()
    (team / "planner" / "tree.py").write_text("from team.planner.unused import x\n\ndef grow(): ...\n")
    assert "planner/unused.py" in {str(p.relative_to(team)) for p in source_files(type(make_agent(ENTRY)))}
    assert fingerprint() != before


def test_a_broken_neighbour_is_read_all_the_same(team: Path) -> None:
    (team / "planner" / "late.py").write_text("def broken(:\n")
    assert team / "planner" / "late.py" in source_files(type(make_agent(ENTRY)))


def test_the_autopilot_is_more_than_its_file_and_no_part_of_the_world() -> None:
    files = source_files(type(make_agent("dohyo.agents.experts.autopilot:Autopilot")))
    names = {path.name for path in files}
    assert {"autopilot.py", "surroundings.py", "passing.py"} <= names
    assert {path.parents[1].name for path in files} <= {"agents", "main"} | {path.parent.name for path in files}
    assert not [path for path in files if {"sumo_networks", "evaluation", "service"} & set(path.parts)]


def test_files_that_cannot_be_read_are_refused_by_name(team: Path) -> None:
    agent = make_agent(ENTRY)
    weights, lost = team / "weights.bin", team / "lost.bin"
    weights.write_bytes(b"weights")
    agent.files = (weights,)  # type: ignore[attr-defined]  # an agent may name files of its own
    assert agent_info(agent, ENTRY).files_sha256 == hashlib.sha256(b"weights").hexdigest()
    for unreadable, why in ((lost, "No such file"), (team, "Is a directory")):
        agent.files = (weights, unreadable)  # type: ignore[attr-defined]
        with pytest.raises(InvalidInputError, match=f"agent 'driver': files: cannot read '{unreadable}': {why}"):
            agent_info(agent, ENTRY)


def test_a_class_without_a_file_has_no_sources() -> None:
    with pytest.raises((TypeError, OSError)):
        source_files(type("Typed", (), {"__module__": "builtins"}))
