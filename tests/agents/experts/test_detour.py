"""Planners that go round what stands in their lane: PDM-Closed and MBAPPE, through hand-made scenes."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from dohyo.agents.experts.detour import Detour
from dohyo.agents.experts.pdm import PdmClosed
from dohyo.agents.mcts.mbappe import Mbappe
from dohyo.agents.mcts.study.study import ARMS
from dohyo.agents.planning.prediction import constant_velocity
from dohyo.agents.planning.scene import SceneBuilder
from dohyo.evaluation.agent import Agent
from dohyo.sumo_networks.scenario import Mission, Place
from dohyo.sumo_networks.world import ActorKind, World
from tests.agents.driving import drive, fronts, observed, speeds, touched
from tests.worlds import LANE_M, Scene, straight_road

WEST = math.pi


def mbappe(passing: bool = True) -> Mbappe:
    return Mbappe(predictor="constant_velocity", simulations=64, passing=passing)


@pytest.fixture(params=[PdmClosed, mbappe])
def planner(request: pytest.FixtureRequest) -> Agent:
    made: Agent = request.param()
    return made


def lefts(worlds: list[World]) -> np.ndarray:
    """How far the ego is to the left of its route, m."""
    return np.array([world.egos.lateral[0] for world in worlds])


def out_at(worlds: list[World]) -> float:
    """When the ego went into the lane beside, s."""
    return next((world.time for world, left in zip(worlds, lefts(worlds), strict=True) if left > 1.6), math.inf)


def parked(scene: Scene, left: float = 0.0) -> Scene:
    """With a car that is parked 60 m ahead."""
    return scene.with_actor(160.0, left=left, kind=ActorKind.STATIC, length=4.6, width=1.8)


def outer_lane() -> Scene:
    """A car is parked in the ego's lane; the lane to its left is of the same direction."""
    return parked(straight_road().with_ego(x=100.0, speed=8.0))


def inner_lane() -> Scene:
    """Both lanes are blocked; the lane to the ego's left is the oncoming one."""
    lane = "w_e_1"
    mission = Mission(start=Place(lane=lane), goal=Place(lane=lane, position_m=-1.0))
    scene = dataclasses.replace(straight_road(), mission=mission).with_ego(x=100.0, speed=8.0)
    return parked(parked(scene), left=-LANE_M)


@pytest.mark.parametrize("x", [100.0, 100.3, 100.7])
@pytest.mark.parametrize("speed", [0.0, 4.0])
def test_it_knows_how_far_it_has_driven(x: float, speed: float) -> None:
    detour, scenes = Detour(4.5, 1.8), SceneBuilder()
    for world in straight_road().with_ego(x=x, speed=speed).worlds(10.0):
        observation = observed(PdmClosed(), world)
        detour.update(observation, scenes.update(observation))
    assert detour._progress == pytest.approx(10.0 * speed, abs=0.05)


@pytest.mark.parametrize("scene", [outer_lane(), inner_lane()], ids=["lane beside", "oncoming lane"])
def test_it_passes_a_parked_car_and_returns(planner: Agent, scene: Scene) -> None:
    worlds = drive(planner, scene, 22.0)
    assert touched(worlds) == set()
    assert fronts(worlds)[-1] > 200.0
    assert 1.8 < lefts(worlds).max() < 4.3
    assert abs(lefts(worlds)[-1]) < 0.35, "it is back in its lane"


def test_it_waits_for_those_who_come_and_passes_then(planner: Agent) -> None:
    scene = inner_lane()
    for x in range(190, 291, 25):
        scene = scene.with_actor(float(x), 10.0, left=LANE_M, heading=WEST)
    worlds = drive(planner, scene, 35.0)
    assert touched(worlds) == set()
    assert speeds(worlds).min() < 0.5, "it stood"
    last_passes = (290.0 - 150.0) / 10.0
    assert last_passes - 3.0 < out_at(worlds) < last_passes + 8.0
    assert fronts(worlds)[-1] > 200.0


def test_it_waits_for_followers_in_the_lane_beside(planner: Agent) -> None:
    scene = outer_lane()
    for x in range(20, 101, 10):
        scene = scene.with_actor(float(x), 8.0, left=LANE_M)
    worlds = drive(planner, scene, 35.0)
    assert touched(worlds) == set()
    out = next(i for i, left in enumerate(lefts(worlds)) if left > 1.5)
    assert min(worlds[out].actors.position[1:, 0]) > worlds[out].egos.position[0, 0] - 3.0, "nobody was still to come"
    assert fronts(worlds)[-1] > 200.0


def test_without_room_it_stops_behind(planner: Agent) -> None:
    worlds = drive(planner, parked(outer_lane(), left=LANE_M), 20.0)
    assert touched(worlds) == set()
    assert speeds(worlds)[-1] < 0.1
    assert 140.0 < fronts(worlds)[-1] < 157.0
    assert abs(lefts(worlds)).max() < 0.3


@pytest.mark.parametrize(
    "made", [lambda: PdmClosed(passing=False), lambda: PdmClosed(variant="published"), lambda: mbappe(passing=False)]
)
def test_without_the_setting_and_as_published_it_passes_nothing(made: type[Agent]) -> None:
    worlds = drive(made(), outer_lane(), 20.0)
    assert touched(worlds) == set()
    assert fronts(worlds)[-1] < 157.8


def test_the_arms_of_the_thesis_pass_nothing() -> None:
    assert [arm.settings["passing"] for name, arm in ARMS.items() if name.startswith("thesis")] == [False] * 6


def test_those_beside_the_way_round_stay_in_the_forecast() -> None:
    """Bicycles need a small step to the left; the planner's own offsets may lead farther, into the oncoming lane."""
    scene = dataclasses.replace(inner_lane(), bodies=()).with_ego(x=100.0, speed=4.0)
    for x in range(125, 170, 9):
        scene = scene.with_actor(float(x), 2.8, left=-0.9, kind=ActorKind.BICYCLE, length=1.8, width=0.65)
    for x in range(105, 220, 6):
        scene = scene.with_actor(float(x), left=-LANE_M, kind=ActorKind.STATIC, length=4.6, width=1.8)
    for x in range(190, 420, 45):
        scene = scene.with_actor(float(x), 8.0, left=LANE_M, heading=WEST)
    planner, builder, detour = PdmClosed(), SceneBuilder(), Detour(4.5, 1.8)
    beside = 0
    for world in drive(planner, scene, 12.0):
        observation = observed(planner, world)
        seen = builder.update(observation)
        detour.update(observation, seen)
        forecast = constant_velocity(seen)
        if detour.passing:
            np.testing.assert_array_equal(detour.cleared(seen, forecast), forecast)
            beside += int((np.abs(seen.actors.heading) > 3.0).sum())
    assert beside > 0, "it passed bicycles while others came"


@pytest.mark.parametrize("speed", [3.0, 8.0])
def test_it_keeps_to_the_right_for_those_who_drive_over_the_middle(planner: Agent, speed: float) -> None:
    scene = dataclasses.replace(inner_lane(), bodies=()).with_ego(x=100.0, speed=speed)
    for x in range(170, 300, 30):
        scene = scene.with_actor(float(x), 8.0, left=1.7, heading=WEST)
    worlds = drive(planner, scene, 14.0)
    assert touched(worlds) == set()
    assert lefts(worlds).min() < -0.3
    assert abs(lefts(worlds)[-1]) < 0.35, "it is back in the middle"
