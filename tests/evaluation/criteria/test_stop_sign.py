from __future__ import annotations

import dataclasses
import math

import pytest

from dohyo.evaluation.criteria.stop_sign import StopSign
from dohyo.evaluation.records.specifications import InfractionKind
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
