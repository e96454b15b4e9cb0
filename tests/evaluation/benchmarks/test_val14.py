"""val14: it is complete, its scenarios are what they are called, and their routes ask for nothing that is forbidden."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from dohyo.agents.experts.autopilot import Autopilot
from dohyo.evaluation.authoring.scenario_types import TYPES, Run
from dohyo.evaluation.benchmarks.benchmark import load_benchmark
from dohyo.evaluation.episode.runner import drive_episode
from dohyo.evaluation.scores.nuplan.frames import Frames
from dohyo.evaluation.scores.nuplan.score import OUTSIDE_M, drivable_area, driving_direction
from dohyo.sumo_networks.ego.dynamics import VehicleParameters
from dohyo.sumo_networks.networks.catalog import load_network
from dohyo.sumo_networks.objects import ObjectStates
from dohyo.sumo_networks.routes.routing import plan_route
from dohyo.sumo_networks.scenario import Scenario
from dohyo.sumo_networks.simulation.traffic_log import SHIPPED, read_log

SCENARIOS = {scenario.name: scenario for scenario in load_benchmark("val14").scenarios([0])}
BEYOND_M = 5.0


def type_of(name: str) -> str:
    return name.partition(".")[0]


def test_there_are_twenty_of_each_type_and_none_twice_in_one() -> None:
    """A run may be of several types: six stand in two of them."""
    assert Counter(map(type_of, SCENARIOS)) == dict.fromkeys(TYPES, 20)
    moments = [(s.network, s.seed, s.missions[0].start, s.log) for s in SCENARIOS.values()]
    assert len({(type_of(name), moment) for name, moment in zip(SCENARIOS, moments, strict=True)}) == 280
    assert len(set(moments)) == 274


def test_every_recording_comes_with_dohyo() -> None:
    assert {name for name, s in SCENARIOS.items() if not (SHIPPED / f"{s.log}.npz").exists()} == set()


def on_its_path(scenario: Scenario) -> Frames:
    """An ego that is drawn along its route as far as the reference came, without a driver."""
    network = load_network(scenario.network)
    route, car = plan_route(network, scenario.missions[0]), VehicleParameters()
    spacing = route.length / (len(route.position) - 1)
    rows = min(len(route.position), int(((scenario.reference_m or 0.0) + BEYOND_M) / spacing) + 1)
    size = np.full((rows, 2), (car.length, car.width))
    boxes = np.column_stack([route.position[:rows], route.heading[:rows], size])
    nobody = ObjectStates.empty()
    return Frames(network, route, boxes, np.full(rows, 10.0), np.arange(rows) * spacing, (nobody,) * rows)


@pytest.mark.slow
@pytest.mark.parametrize("kind", TYPES)
def test_no_route_leaves_the_drivable_area_or_its_direction(kind: str) -> None:
    for name, scenario in SCENARIOS.items():
        if type_of(name) == kind:
            frames = on_its_path(scenario)
            assert drivable_area(frames) == 1.0, f"{name}: {frames.outside.max():.2f} m of {OUTSIDE_M} m"
            assert driving_direction(frames) == 1.0, name


@pytest.mark.slow
@pytest.mark.parametrize("kind", TYPES)
def test_a_scenario_of_each_type_is_one_for_the_reference_among_the_recorded(kind: str) -> None:
    scenario = next(one for name, one in SCENARIOS.items() if type_of(name) == kind)
    _, trajectory = drive_episode(scenario, {"ego": Autopilot()})
    ego = trajectory.key == -1
    heading, speed, progress = (
        column[ego].astype(np.float64) for column in (trajectory.heading, trajectory.speed, trajectory.progress)
    )
    position = np.column_stack([trajectory.x[ego], trajectory.y[ego]]).astype(np.float64)
    network, log = load_network(scenario.network), read_log(str(scenario.log), SHIPPED)
    run = Run(network, plan_route(network, scenario.missions[0]), log, heading, speed, position, progress)
    assert TYPES[kind](run)
