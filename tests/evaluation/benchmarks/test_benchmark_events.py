"""Scripted events in benchmarks: by hand, automatically, in the scenario's record, and in its score."""

from __future__ import annotations

import copy
import re
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dohyo.evaluation.agent import Agent, AgentSpec, Observation
from dohyo.evaluation.benchmarks.benchmark import Benchmark, load_benchmark
from dohyo.evaluation.episode.runner import run_episode
from dohyo.evaluation.records.record import EpisodeRecord
from dohyo.evaluation.records.specifications import InfractionKind
from dohyo.evaluation.scores.driving import driving_score
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.events import EVENTS
from dohyo.sumo_networks.events.placement import check_placement
from dohyo.sumo_networks.networks.catalog import load_network
from dohyo.sumo_networks.routes.routing import plan_route
from dohyo.sumo_networks.scenario import Mission

COUNTRY: dict[str, Any] = {
    "name": "eventful",
    "description": "Events on a country road",
    "headline": "driving_score",
    "metric": "driving score",
    "network": "district",
    "missions": [
        {
            "name": "there",
            "start": {"lane": "hill_road_2_1", "position_m": 5.0},
            "goal": {"lane": "avenue_6_2", "position_m": -5.0},
        }
    ],
}
BRAKE = {"kind": "hard_brake", "name": "brake", "at_m": 100.0}


def benchmark(**changes: Any) -> Benchmark:
    return Benchmark.model_validate(copy.deepcopy(COUNTRY) | changes)


def with_events(*events: dict[str, Any], **changes: Any) -> Benchmark:
    return benchmark(missions=[{**COUNTRY["missions"][0], "events": list(events)}], **changes)


def test_without_events_nothing_is_written_of_them() -> None:
    for name in ("corl2017", "fleet", "nocrash", "quickstart"):
        document = load_benchmark(name).model_dump(mode="json")
        assert all("events" not in cell for cell in document["cells"])
        assert all("events" not in mission for group in document["missions"].values() for mission in group)
        for scenario in load_benchmark(name).scenarios([0])[:1]:
            assert scenario.events == ()
            assert all(type(mission) is Mission for mission in scenario.missions)


def test_events_are_part_of_the_version() -> None:
    versions = {one.sha256 for one in (benchmark(), benchmark(events="auto"), with_events(BRAKE))}
    assert len(versions) == 3
    again = Benchmark.model_validate(with_events(BRAKE, events="auto").model_dump(mode="json"))
    assert again.sha256 == with_events(BRAKE, events="auto").sha256


def test_events_by_hand_are_in_the_scenario() -> None:
    (scenario,) = with_events(BRAKE).scenarios([3])
    (event,) = scenario.events
    assert (event.name, event.kind, event.at_m, event.ego) == ("brake", "hard_brake", 100.0, None)


def test_auto_places_events_anew_for_every_seed_and_the_same_for_one() -> None:
    one, two = benchmark(events="auto").scenarios([0, 1])
    assert one.events
    assert [event.kind for event in one.events] != [event.kind for event in two.events]
    assert benchmark(events="auto").scenarios([0])[0] == one


def test_auto_takes_kinds_and_distances() -> None:
    told = {"every_m": [400.0, 500.0], "kinds": ["hard_brake", "slow_bicycles"]}
    (scenario,) = benchmark(events=told).scenarios([0])
    assert {event.kind for event in scenario.events} <= {"hard_brake", "slow_bicycles"}
    assert 2 <= len(scenario.events) <= 6


def test_auto_keeps_away_from_those_by_hand() -> None:
    (scenario,) = with_events(BRAKE, events="auto").scenarios([0])
    first, *others = scenario.events
    assert first.name == "brake"
    assert others
    assert all(abs((event.at_m or 0.0) - 100.0) >= 200.0 for event in others)


def test_egos_that_drive_together_have_their_own() -> None:
    missions = [
        {**COUNTRY["missions"][0], "name": "a", "events": [BRAKE]},
        {**COUNTRY["missions"][0], "name": "b", "start": {"lane": "hill_road_2_1", "position_m": 40.0}},
    ]
    cells = [{"name": "all", "network": "district", "missions": "all", "together": True, "events": "auto"}]
    given = {key: value for key, value in COUNTRY.items() if key not in ("network", "missions")}
    (scenario,) = Benchmark.model_validate({**given, "cells": cells, "missions": {"all": missions}}).scenarios([0])
    assert {event.ego for event in scenario.events} == {"a", "b"}
    assert scenario.events[0].name == "a-brake"


@pytest.mark.parametrize(
    ("made", "message"),
    [
        (with_events({**BRAKE, "at_m": 5000.0}), "mission 1: event 'brake' .* the route ends"),
        (with_events(BRAKE, {**BRAKE, "at_m": 150.0}), "event names must be unique"),
        (benchmark(events={"kinds": ["highway_exit"]}), "mission 1: no event of kind highway_exit fits"),
        (benchmark(events={"kinds": ["hard_break"]}), "no kind of event named 'hard_break'"),
    ],
)
def test_what_cannot_happen_is_an_error_that_names_the_mission(made: Benchmark, message: str) -> None:
    with pytest.raises(InvalidInputError, match=message):
        made.scenarios([0])


class Cruise(Agent):
    """Keeps its lane at 12 m/s, whatever happens."""

    spec = AgentSpec(name="cruise", track="map", sensors=("speedometer",), control="lane_command")

    def reset(self, mission: Mission, seed: int) -> None:
        pass

    def act(self, observation: Observation) -> np.ndarray:
        return np.array([12.0, 0.0], np.float32)


def driven(event: dict[str, Any]) -> EpisodeRecord:
    highway = {
        "network": "a10",
        "missions": [
            {
                "name": "on",
                "start": {"lane": "360414561_0", "position_m": 5.0},
                "goal": {"lane": "360414561_0", "position_m": 550.0},
                "events": [event],
            }
        ],
    }
    (scenario,) = benchmark(**highway).scenarios([0])
    return run_episode(scenario, {"ego": Cruise()})


def test_the_record_says_that_the_ego_did_not_yield_and_the_score_pays() -> None:
    yielding = {"kind": "yield_to_emergency_vehicle", "name": "blue", "at_m": 150.0, "wait_s": 5.0}
    record = driven(yielding)
    (ego,) = record.egos
    (one,) = ego.infractions
    assert one.kind is InfractionKind.YIELD_EMERGENCY
    assert one.actor == "event:blue-0"
    assert driving_score(ego, "2.0") == pytest.approx(70.0)
    assert driving_score(ego, "1.0") == pytest.approx(100.0)
    assert [event.kind for event in record.scenario.events] == ["yield_to_emergency_vehicle"]
    assert record.record_hash == driven(yielding).record_hash


def test_an_event_that_is_never_over_is_a_scenario_timeout() -> None:
    record = driven({"kind": "slow_bicycles", "name": "slow", "at_m": 100.0, "speed_mps": 14.0, "timeout_s": 10.0})
    assert [one.kind for one in record.egos[0].infractions] == [InfractionKind.SCENARIO_TIMEOUT]
    assert record.egos[0].infractions[0].magnitude == pytest.approx(10.0)


def test_every_event_of_a_scenario_can_be_placed_again() -> None:
    (scenario,) = benchmark(events="auto").scenarios([5])
    network = load_network("district")
    for event in scenario.events:
        check_placement(event, "ego", network, plan_route(network, scenario.missions[0]))


def test_the_page_on_events_or_the_reference_has_every_kind_and_its_examples_can_be_driven() -> None:
    reference = Path(__file__).parents[3] / "docs" / "reference"
    page, modules = (reference / "events.md").read_text(), (reference / "api" / "world.md").read_text()
    named = set(re.findall(r"`([a-z_]+)`", page))
    assert all(kind in named or f"automodule:: {event.__module__}\n" in modules for kind, event in EVENTS.items())
    by_hand, auto, busy = (tomllib.loads(text) for text in re.findall(r"```toml\n(.*?)```", page, re.DOTALL))
    for given in (auto, {**auto, "events": None, "missions": by_hand["missions"]}, {**auto, **busy}):
        (scenario,) = Benchmark.model_validate(given).scenarios([0])
        assert scenario.events
    assert scenario.traffic.flows


@pytest.mark.parametrize("kind", ["dynamic_object_crossing", "opposite_runs_red_light", "parking_cut_in"])
def test_the_page_has_the_numbers_in_use(kind: str) -> None:
    page = (Path(__file__).parents[3] / "docs" / "reference" / "events.md").read_text()
    (row,) = [line for line in page.splitlines() if line.startswith(f"| `{kind}` |")]
    for name in ("reaction_time_s", "minimum_distance_m"):
        assert f"{EVENTS[kind].model_fields[name].default:g}" in re.findall(r"\d+(?:\.\d+)?", row)
