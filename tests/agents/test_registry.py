from __future__ import annotations

import json
from importlib.metadata import EntryPoint

import pytest

from dohyo.agents import registry
from dohyo.agents.registry import GROUP, agent_entries, agent_schema, agent_view, describe_agent, resolve
from dohyo.evaluation.agent import make_agent
from dohyo.evaluation.entry import load_entry
from dohyo.evaluation.settings import check_against, settings_schema
from dohyo.evaluation.sources import source_files
from dohyo.sumo_networks.errors import InvalidInputError, UnknownNameError


def test_the_experts_are_registered_and_can_be_made() -> None:
    entries = agent_entries()
    assert list(entries) == sorted(entries)
    for name in ("autopilot", "reckless", "random"):
        assert make_agent(resolve(name)).spec.name == name


def test_what_names_its_class_needs_no_registration() -> None:
    assert resolve("somewhere.else:Policy") == "somewhere.else:Policy"


def test_an_unknown_agent_gets_the_nearest_name() -> None:
    with pytest.raises(UnknownNameError, match="did you mean 'autopilot'"):
        resolve("autopilt")


def offered(monkeypatch: pytest.MonkeyPatch, *values: str) -> None:
    points = [EntryPoint("twice", value, GROUP) for value in values]
    monkeypatch.setattr(registry, "entry_points", lambda group: points)


def test_two_agents_of_one_name_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    offered(monkeypatch, "a:Agent", "b:Agent")
    with pytest.raises(InvalidInputError, match="'twice' is offered twice: a:Agent and b:Agent"):
        agent_entries()


def test_the_same_agent_offered_twice_is_one(monkeypatch: pytest.MonkeyPatch) -> None:
    offered(monkeypatch, "a:Agent", "a:Agent")
    assert agent_entries() == {"twice": "a:Agent"}


@pytest.mark.parametrize("name", agent_entries())
def test_what_is_declared_of_an_agent_is_what_its_class_says(name: str) -> None:
    view, info = agent_view(name), describe_agent(resolve(name), {})
    assert (view.track, view.sensors, view.control) == (info.track, info.sensors, info.control)


def test_the_stored_settings_are_those_of_the_constructors() -> None:
    for name, entry in agent_entries().items():
        derived = json.loads(json.dumps(settings_schema(load_entry(entry, "agent"))))
        assert agent_schema(name) == derived, "python -m dohyo.agents.registry writes them"
        check_against(agent_schema(name), name, {})


def test_an_agent_of_another_package_is_asked_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    offered(monkeypatch, "tests.evaluation.agents:Steady")
    assert agent_view("twice").entry == "tests.evaluation.agents:Steady"
    assert agent_view("twice").control == make_agent("tests.evaluation.agents:Steady").spec.control


@pytest.mark.parametrize("name", ["ghrl", "griad", "mbappe", "parking", "pdm-hybrid", "priboot", "rlad", "rlfold"])
def test_a_drivers_digest_has_no_training_in_it(name: str) -> None:
    """Else a change of how policies are learned would make records of drivers look stale that drive as before."""
    told = [str(path) for path in source_files(load_entry(resolve(name), "agent"))]
    assert told
    assert [path for path in told if any(part in path for part in ("/training", "/runs/", "/algorithms/"))] == []
