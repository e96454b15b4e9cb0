from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from dohyo.evaluation.criteria.stop_sign import StopSign
from dohyo.evaluation.records.specifications import InfractionKind
from dohyo.sumo_networks.rules.right_of_way import RightOfWay
from dohyo.sumo_networks.scenario import Mission, Place, Scenario, Traffic
from dohyo.sumo_networks.world import LightState, World
from tests.conftest import Start
from tests.lights import SIDE_ROAD_X, asking, line_y, side_road
from tests.worlds import Scene, lit_crossing, run, stop_sign_crossing


def standing_then_driving(to_line: float, wait_s: float = 0.5) -> Scene:
    """An ego whose front stands so far before the western stop line, and then drives on."""
    scene = stop_sign_crossing()
    x = scene.stop_line("w_c_0") - 2.25 - to_line
    return scene.with_ego(x=x, speed=lambda time: 5.0 if time > wait_s else 0.0)


@pytest.mark.parametrize(("to_line", "count"), [(0.05, 0), (1.0, 0), (3.9, 0), (4.1, 1), (8.0, 1)])
def test_the_ego_must_stand_within_four_metres_of_the_line(to_line: float, count: int) -> None:
    assert len(run(standing_then_driving(to_line), StopSign(), seconds=3).infractions) == count


def test_rolling_over_the_line_counts_once() -> None:
    scene = stop_sign_crossing()
    rolling = scene.with_ego(x=scene.stop_line("w_c_0") - 10, speed=2.0)
    (infraction,) = run(rolling, seconds=8).infractions
    assert infraction.kind is InfractionKind.STOP_SIGN
    assert infraction.actor == "w_c_0"
    assert infraction.magnitude == pytest.approx(2.0)
    assert infraction.unit == "m/s"


@pytest.mark.parametrize(("left", "count"), [(-2.0, 1), (-5.0, 1), (-13.0, 0)])
def test_the_line_is_passed_beside_the_road_too(left: float, count: int) -> None:
    scene = stop_sign_crossing()
    rolling = scene.with_ego(x=scene.stop_line("w_c_0") - 10, speed=2.0, left=left)
    assert len(run(rolling, StopSign(), seconds=8).infractions) == count


@pytest.mark.parametrize(("slowest", "count"), [(0.09, 0), (0.11, 1)])
def test_slower_than_a_tenth_of_a_metre_per_second_is_standing(slowest: float, count: int) -> None:
    scene = stop_sign_crossing()
    x = scene.stop_line("w_c_0") - 2.25 - 5.0
    creeping = scene.with_ego(x=x, speed=lambda time: slowest if 1.0 < time < 1.5 else 2.0)
    assert len(run(creeping, StopSign(), seconds=5).infractions) == count


def test_stopping_with_the_front_past_the_line_is_too_late() -> None:
    scene = stop_sign_crossing()
    x = scene.stop_line("w_c_0") - 2.25 - 0.5
    late = scene.with_ego(x=x, speed=lambda time: 2.0 if time < 0.5 or time > 2 else 0.0)
    assert len(run(late, StopSign(), seconds=3).infractions) == 1


def test_coming_to_rest_in_the_very_tick_of_the_crossing_is_too_late() -> None:
    scene = stop_sign_crossing()
    x = scene.stop_line("w_c_0") - 2.25 - 0.005
    late = scene.with_ego(x=x, speed=lambda time: 2.0 if time < 0.05 else 0.09)
    assert len(run(late, StopSign(), seconds=3).infractions) == 1


def test_one_stop_does_not_serve_two_signs() -> None:
    first = standing_then_driving(1.0).worlds(3)
    scene = stop_sign_crossing()
    again = scene.with_ego(x=scene.stop_line("w_c_0") - 2.25 - 1.0, speed=5.0).worlds(1, after=first[-1])
    assert len(run([*first, *again], StopSign()).infractions) == 1


def test_the_road_with_priority_need_not_stop() -> None:
    scene = stop_sign_crossing().with_ego(x=4.8, y=-20, heading=math.pi / 2, speed=10)
    assert run(scene, StopSign()).infractions == []


def test_a_line_crossed_backwards_does_not_count() -> None:
    scene = stop_sign_crossing().with_ego(x=-6, heading=math.pi, speed=10)
    assert run(scene, StopSign()).infractions == []


def test_a_light_is_no_stop_sign() -> None:
    assert run(lit_crossing().with_ego(x=-20, speed=10), StopSign()).infractions == []


def test_a_line_without_a_sign_does_not_count_in_a_network_with_signs() -> None:
    scene = lit_crossing()
    stop_lines = scene.network.stop_lines
    elsewhere = stop_lines.lane == scene.network.lane_index["e_c_0"]
    network = dataclasses.replace(scene.network, stop_lines=dataclasses.replace(stop_lines, stop_sign=elsewhere))
    assert run(dataclasses.replace(scene, network=network).with_ego(x=-20, speed=10), StopSign()).infractions == []


# Green right-turn arrows


def up_to_the_junction(start: Start, scene: Scene, stands: bool) -> list[World]:
    """Drives in SUMO over the side road's line; if told, after standing before it until the light shows no colour."""
    empty = Traffic(warm_up_s=0.0)
    simulation, world = start(Scenario(network=str(scene.network.path), missions=(scene.mission,), traffic=empty))
    worlds, line, stood = [world], line_y(scene), not stands
    signal = scene.route.passages[0].signal
    for _ in range(200):
        egos = worlds[-1].egos
        to_line, speed = line - egos.position[0, 1] - egos.length[0] / 2, egos.speed[0]
        stood = stood or (to_line < 4.0 and speed < 0.05 and worlds[-1].signals[signal] == LightState.OFF)
        brakes = not stood and speed**2 > 2 * 2.0 * max(to_line - 2.0, 0.0)
        worlds.append(simulation.tick(np.array([[-6.0 if brakes else 1.5, 0.0]])))
        if to_line < -1.0:
            return worlds
    raise AssertionError("it never crossed the line")


@pytest.mark.parametrize(
    ("letter", "stands", "count"),
    [("s", False, 1), ("s", True, 0), ("G", False, 0), ("o", False, 0), ("O", False, 0)],
)
def test_at_a_green_right_turn_arrow_the_ego_must_stand(start: Start, letter: str, stands: bool, count: int) -> None:
    worlds = up_to_the_junction(start, side_road((letter, 90), ("s", 5)), stands)
    found = run(worlds, StopSign()).infractions
    assert [(one.kind, one.actor) for one in found] == [(InfractionKind.STOP_SIGN, "s_c_0")] * count


def test_who_stood_at_red_may_drive_on_when_the_arrow_comes(start: Start) -> None:
    worlds = up_to_the_junction(start, side_road(("r", 12), ("s", 90)), stands=True)
    assert run(worlds).infractions == []


def test_an_arrow_is_for_who_turns_right_alone() -> None:
    mission = Mission(start=Place(lane="s_c_0"), goal=Place(lane="c_w_0"))
    scene = dataclasses.replace(side_road(("s", 90)), mission=mission)
    scene = scene.with_ego(SIDE_ROAD_X, 5.0, y=line_y(scene) - 5.0, heading=math.pi / 2)
    worlds = [asking(world, s_c_0_r=RightOfWay.STOP) for world in scene.worlds(2)]
    assert run(worlds, StopSign()).infractions == []


@pytest.mark.parametrize(("left", "count"), [(LightState.RED, 1), (LightState.GREEN, 0)])
def test_off_the_route_an_arrow_counts_where_nobody_may_pass_freely(left: LightState, count: int) -> None:
    mission = Mission(start=Place(lane="w_c_0"), goal=Place(lane="c_e_0"))
    scene = dataclasses.replace(side_road(("s", 90)), mission=mission).with_lights(r=LightState.OFF, l=left)
    scene = scene.with_ego(SIDE_ROAD_X, 5.0, y=line_y(scene) - 5.0, heading=math.pi / 2)
    worlds = [asking(world, s_c_0_r=RightOfWay.STOP) for world in scene.worlds(2)]
    assert len(run(worlds, StopSign()).infractions) == count
