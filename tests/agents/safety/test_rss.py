"""RSS: hand calculations, worst cases driven out, and the watch that keeps the critical intervals."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numba import njit

from dohyo.agents.safety.rss import (
    COLUMNS,
    EGO,
    GAP,
    LEAST,
    LITERATURE,
    SIDE_GAP,
    SIDE_LEAST,
    RssConstants,
    behind_distance,
    crossing_distance,
    dangerous,
    judge,
    oncoming_distance,
    side_distance,
)
from dohyo.agents.safety.rss_monitor import SENSORS, RssMonitor
from dohyo.sumo_networks.sensors import make_sensors
from dohyo.sumo_networks.world import World
from tests.worlds import Scene, straight_road

WEST, NORTH = math.pi, math.pi / 2
STEP_S = 0.001
HALF_LENGTH, HALF_WIDTH = 2.25, 0.9

SPEEDS = st.floats(0.0, 20.0)
CONSTANTS = st.builds(
    RssConstants,
    reaction_s=st.floats(0.1, 1.0),
    acceleration=st.floats(0.5, 4.0),
    braking=st.floats(2.0, 6.0),
    hardest_braking=st.floats(6.0, 9.0),
    side_acceleration=st.floats(0.05, 1.0),
    side_braking=st.floats(0.5, 2.0),
    side_margin_m=st.floats(0.05, 0.5),
)


@njit
def position(t: np.ndarray, speed: float, acceleration: float, braking: float, reaction: float) -> np.ndarray:
    """Way of somebody who accelerates until the reaction, then brakes to a stop; worked out by small steps."""
    out, v, x = np.zeros(len(t)), speed, 0.0
    for i in range(len(t)):
        out[i] = x
        after = v + acceleration * STEP_S if t[i] < reaction else max(v - braking * STEP_S, min(v, 0.0))
        x += 0.5 * (v + after) * STEP_S
        v = after
    return out


# By hand


def test_behind_who_brakes_as_hard_as_it_can() -> None:
    # 10 x 0.5 + 3.5 x 0.25 / 2 + 11.75^2 / 8 - 10^2 / 16 = 5 + 0.4375 + 17.2578 - 6.25
    assert behind_distance(10.0, 10.0, LITERATURE.numbers) == pytest.approx(16.4453, abs=1e-4)
    # 10 x 0.3 + 4 x 0.09 / 2 + 11.2^2 / 10 - 10^2 / 16 = 3 + 0.18 + 12.544 - 6.25
    assert behind_distance(10.0, 10.0, EGO.numbers) == pytest.approx(9.474, abs=1e-4)


def test_nobody_needs_a_distance_to_who_is_much_faster() -> None:
    assert behind_distance(2.0, 20.0, EGO.numbers) == 0.0


def test_standing_behind_somebody_who_stands() -> None:
    # 4 x 0.09 / 2 + 1.2^2 / 10
    assert behind_distance(0.0, 0.0, EGO.numbers) == pytest.approx(0.324)


def test_towards_each_other_both_need_room_to_stop() -> None:
    # 3 + 0.18 + 12.544, and 1.5 + 0.18 + 6.2^2 / 10
    assert oncoming_distance(10.0, 5.0, EGO.numbers) == pytest.approx(15.724 + 5.524)


def test_side_by_side() -> None:
    # Each 0.06 / 2 x 0.3 + 0.06^2 / 1.6, and a margin of 0.2 m.
    assert side_distance(0.0, 0.0, EGO.numbers) == pytest.approx(0.2 + 2 * (0.009 + 0.00225))
    # 0.5 m/s towards the other: (0.5 + 0.56) / 2 x 0.3 + 0.56^2 / 1.6
    assert side_distance(0.5, 0.0, EGO.numbers) == pytest.approx(0.2 + 0.01125 + 0.159 + 0.196)
    assert side_distance(-2.0, -2.0, EGO.numbers) == pytest.approx(0.2)


def test_who_crosses_keeps_going_until_the_ego_stands() -> None:
    # The ego stands after 0.3 + 11.2 / 5 = 2.54 s.
    assert crossing_distance(10.0, 1.5, False, EGO.numbers) == pytest.approx(0.2 + 1.5 * 2.54)
    assert crossing_distance(10.0, -1.5, False, EGO.numbers) == pytest.approx(0.2)
    # Who must give way only has to be able to stop: 10^2 / 10
    assert crossing_distance(10.0, 10.0, True, EGO.numbers) == pytest.approx(10.2)


# The worst that may happen


@given(SPEEDS, SPEEDS, CONSTANTS)
def test_no_collision_when_the_distance_to_who_is_ahead_was_kept(rear: float, front: float, c: RssConstants) -> None:
    gap = behind_distance(rear, front, c.numbers)
    t = np.arange(0.0, 15.0, STEP_S)
    behind = position(t, rear, c.acceleration, c.braking, c.reaction_s)
    ahead = position(t, front, 0.0, c.hardest_braking, 0.0)
    assert (gap + ahead - behind).min() > -0.05


@given(SPEEDS, SPEEDS, CONSTANTS)
def test_no_more_distance_than_the_worst_case_needs(rear: float, front: float, c: RssConstants) -> None:
    gap = behind_distance(rear, front, c.numbers)
    t = np.arange(0.0, 15.0, STEP_S)
    behind = position(t, rear, c.acceleration, c.braking, c.reaction_s)
    ahead = position(t, front, 0.0, c.hardest_braking, 0.0)
    assert gap == 0.0 or gap + ahead[-1] - behind[-1] < 0.05


@given(SPEEDS, SPEEDS, CONSTANTS)
def test_no_collision_when_the_distance_to_who_comes_was_kept(one: float, other: float, c: RssConstants) -> None:
    gap, t = oncoming_distance(one, other, c.numbers), np.arange(0.0, 15.0, STEP_S)
    ways = [position(t, speed, c.acceleration, c.braking, c.reaction_s)[-1] for speed in (one, other)]
    assert gap - sum(ways) > -0.1


@given(st.floats(-3.0, 3.0), st.floats(-3.0, 3.0), CONSTANTS)
def test_no_contact_when_the_distance_beside_was_kept(one: float, other: float, c: RssConstants) -> None:
    gap, t = side_distance(one, other, c.numbers), np.arange(0.0, 10.0, STEP_S)
    towards = [position(t, speed, c.side_acceleration, c.side_braking, c.reaction_s) for speed in (one, other)]
    assert (gap - towards[0] - towards[1]).min() > 0.0


@given(SPEEDS, st.floats(0.1, 3.0), CONSTANTS)
def test_who_crosses_is_not_in_the_way_before_the_ego_stands(ego: float, walks: float, c: RssConstants) -> None:
    gap, t = crossing_distance(ego, walks, False, c.numbers), np.arange(0.0, 15.0, STEP_S)
    ways = position(t, ego, c.acceleration, c.braking, c.reaction_s)
    stands = t[int(np.argmax(ways >= ways[-1] - 1e-6))]
    assert gap - walks * stands > 0.0


@given(SPEEDS, SPEEDS, st.floats(0.0, 5.0), CONSTANTS)
def test_who_drives_faster_needs_more_room(rear: float, front: float, more: float, c: RssConstants) -> None:
    assert behind_distance(rear + more, front, c.numbers) >= behind_distance(rear, front, c.numbers)
    assert behind_distance(rear, front + more, c.numbers) <= behind_distance(rear, front, c.numbers)


# All actors at once


def actor(x: float, y: float, speed: float = 0.0, heading: float = 0.0) -> list[float]:
    return [x - 2.25, x + 2.25, y - 0.9, y + 0.9, speed, math.cos(heading), math.sin(heading), 0.0]


def judged(*actors: list[float], speed: float = 10.0) -> np.ndarray:
    rows = np.array(actors).reshape(-1, COLUMNS)
    return judge(speed, 0.0, 0.0, HALF_LENGTH, HALF_WIDTH, rows, EGO.numbers)


def test_gaps_are_those_between_the_boxes() -> None:
    ahead, behind, beside = judged(actor(20.0, 0.0, 10.0), actor(-10.0, 0.0, 10.0), actor(0.0, 3.0))
    assert ahead[GAP] == pytest.approx(15.5)
    assert ahead[LEAST] == pytest.approx(9.474)
    assert ahead[SIDE_GAP] == 0.0
    assert behind[GAP] == pytest.approx(-5.5)
    assert beside[GAP] == 0.0
    assert beside[SIDE_GAP] == pytest.approx(1.2)
    assert beside[SIDE_LEAST] == pytest.approx(side_distance(0.0, 0.0, EGO.numbers))


@pytest.mark.parametrize(
    ("other", "expected"),
    [
        (actor(13.0, 0.0, 10.0), True),  # 8.5 m where 9.47 are asked for
        (actor(14.1, 0.0, 10.0), False),
        (actor(8.0, 3.2, 10.0), False),  # in the lane beside
        (actor(0.0, 1.9), True),  # 0.1 m beside
        (actor(-8.0, 0.0, 15.0), False),  # its business
        (actor(25.0, 0.0, 5.0, WEST), True),  # 20.5 m to somebody who comes
        (actor(28.0, 0.0, 5.0, WEST), False),
        (actor(12.0, -6.0, 2.0, NORTH), True),  # crosses from the right, 4.2 m off: 2 x 2.54 s
        (actor(12.0, -7.4, 2.0, NORTH), False),
        (actor(12.0, 3.0, 2.0, NORTH), False),  # has crossed
    ],
)
def test_dangerous_is_who_is_too_near_both_ways(other: list[float], expected: bool) -> None:
    near, beside = dangerous(judged(other))
    assert bool((near & beside)[0]) is expected


# Critical intervals


def seen(world: World) -> dict[str, np.ndarray]:
    return {sensor.name: sensor.read(world, 0) for sensor in make_sensors(SENSORS)}


def watched(scene: Scene, seconds: float, constants: RssConstants = EGO) -> tuple[RssMonitor, list[bool]]:
    watch, critical = RssMonitor(constants), []
    for world in scene.worlds(seconds):
        watch.update(seen(world))
        critical.append(watch.critical)
    return watch, critical


@pytest.mark.parametrize("constants", [EGO, LITERATURE])
def test_an_interval_lasts_until_the_response_time_after_the_danger(constants: RssConstants) -> None:
    # 6 m behind a vehicle that pulls away: near enough to be dangerous at first only.
    scene = straight_road().with_ego(x=50.0, speed=8.0).with_actor(60.5, lambda t: 8.0 + 6.0 * t)
    watch, critical = watched(scene, 4.0, constants)
    danger = [bool(w) for w in critical]
    assert danger[0]
    ends = danger.index(False)
    alone, last = RssMonitor(constants), -1
    for tick, world in enumerate(scene.worlds(4.0)):
        last = tick if alone.update(seen(world)) else last
    assert ends - last == round(constants.reaction_s / 0.1)
    assert not any(danger[ends:])
    assert watch.share == pytest.approx(ends / len(danger))


def test_an_empty_road_is_never_critical() -> None:
    watch, critical = watched(straight_road().with_ego(x=50.0, speed=10.0), 1.0)
    assert not any(critical)
    assert watch.share == 0.0


def test_the_response_brakes_for_who_is_ahead() -> None:
    (world,) = straight_road().with_ego(x=50.0, speed=10.0).with_actor(62.0, 5.0).worlds(0.0)
    (danger,) = RssMonitor().update(seen(world))
    assert danger.gap == pytest.approx(7.5, abs=0.01)
    assert danger.braking == EGO.braking
    assert danger.side == 0


@pytest.mark.parametrize("x", [50.0, 50.25, 50.5, 50.75])
def test_gaps_are_exact_wherever_the_ego_is_between_two_points_of_the_path(x: float) -> None:
    (world,) = straight_road().with_ego(x=x, speed=10.0).with_actor(x + 12.0, 5.0).worlds(0.0)
    (danger,) = RssMonitor().update(seen(world))
    assert danger.gap == pytest.approx(7.5, abs=0.01)


def test_the_response_brakes_harder_where_the_least_is_not_enough() -> None:
    (world,) = straight_road().with_ego(x=50.0, speed=10.0).with_actor(62.0, 0.0).worlds(0.0)
    (danger,) = RssMonitor().update(seen(world))
    # 10^2 / (2 x 7.2) = 6.9
    assert danger.braking == pytest.approx(6.94, abs=0.01)


def test_the_response_to_who_comes_too_near_beside_is_not_to_go_nearer() -> None:
    scene = straight_road().with_ego(x=50.0, speed=8.0).with_actor(50.0, 8.0, left=2.3, drift=-0.3)
    watch, sides = RssMonitor(), []
    for world in scene.worlds(1.5):
        sides += [danger.side for danger in watch.update(seen(world))]
    assert sides
    assert set(sides) == {1}
    assert all(danger.braking == 0.0 for danger in watch.dangers)


def test_standing_in_danger_is_counted() -> None:
    scene = straight_road().with_ego(x=50.0, speed=0.0).with_actor(54.6, 0.0)
    watch, critical = watched(scene, 3.0)
    assert all(critical)
    assert watch.longest_standing_s == pytest.approx(3.1)
