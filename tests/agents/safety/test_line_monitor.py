"""Line monitor: critical where an ego would pass a closed line, and nowhere else."""

from __future__ import annotations

import numpy as np
import pytest

from dohyo.agents.safety.line_monitor import LineMonitor
from dohyo.agents.safety.rss import EGO, LITERATURE, RssConstants
from dohyo.sumo_networks.arrays import Float32Array
from dohyo.sumo_networks.ego.dynamics import VehicleParameters
from dohyo.sumo_networks.rules.right_of_way import RightOfWay
from dohyo.sumo_networks.world import LightState

RED, YELLOW, GREEN = LightState.RED, LightState.YELLOW, LightState.GREEN
NO_LIGHT = -1
FAR = [1000.0, 1000.0, -1.0, 0.0]


def line(distance: float, light: int, sign: int = RightOfWay.MAJOR) -> Float32Array:
    return np.array([[distance, distance + 20.0, float(light), float(sign)], FAR, FAR, FAR], dtype=np.float32)


def critical(speed: float, distance: float, light: int) -> bool:
    monitor = LineMonitor()
    monitor.update(speed, line(distance, light))
    return monitor.critical


@pytest.mark.parametrize("speed", [0.0, 0.5, 3.0, 8.0, 14.0])
def test_braking_at_the_first_critical_tick_stops_before_a_red_line(speed: float) -> None:
    in_rain = 0.6 * VehicleParameters().max_braking
    distance = 60.0
    while not critical(speed, distance, RED):
        distance -= 0.1 * max(speed, 0.1)
    assert distance > speed**2 / (2.0 * in_rain)


def test_an_ego_that_stands_at_its_distance_is_not_critical_and_one_that_creeps_on_is() -> None:
    assert not critical(0.0, 1.5, RED)
    assert critical(0.0, 0.7, RED)
    assert critical(0.8, 1.2, RED)


def test_green_lines_and_lines_behind_are_no_danger() -> None:
    assert not critical(10.0, 3.0, GREEN)
    assert not critical(10.0, -1.0, RED)
    assert not critical(10.0, 3.0, LightState.OFF)


def test_yellow_is_a_danger_only_where_the_ego_can_stop() -> None:
    assert critical(3.0, 2.5, YELLOW)
    assert not critical(10.0, 5.0, YELLOW)


def test_a_stop_sign_is_a_danger_until_the_ego_has_stood_at_its_line_and_again_at_the_next() -> None:
    monitor = LineMonitor(EGO.model_copy(update={"reaction_s": 0.05}))

    def critical(speed: float, distance: float) -> bool:
        for _ in range(2):
            monitor.update(speed, line(distance, NO_LIGHT, RightOfWay.STOP))
        return monitor.critical

    assert critical(8.0, 5.0)
    assert not critical(0.0, 1.2)
    assert not critical(3.0, 0.6)
    assert critical(8.0, 5.0)
    monitor.reset()
    assert critical(3.0, 0.6)
    assert not critical(0.0, 30.0)
    assert critical(3.0, 0.6)


def behind_a_junction(stop: float) -> Float32Array:
    """A stop sign behind a junction that the ego is about to leave or to enter."""
    signs = np.array([[stop - 9.0, stop + 1.5, -1.0, RightOfWay.MAJOR], [stop, stop + 9.0, -1.0, RightOfWay.STOP]])
    return np.array([*signs, FAR, FAR], dtype=np.float32)


def test_a_stop_sign_behind_the_next_junction_is_a_danger_until_the_ego_has_stood_at_its_line() -> None:
    monitor = LineMonitor(EGO.model_copy(update={"reaction_s": 0.05}))
    for speed, distance, critical in [(8.0, 6.0, True), (0.0, 1.2, False), (2.0, 0.6, False)]:
        monitor.update(speed, behind_a_junction(distance))
        assert monitor.critical == critical


@pytest.mark.parametrize(("constants", "ticks"), [(EGO, 3), (LITERATURE, 5)])
def test_the_interval_outlasts_the_danger_by_the_response_time_and_ends_with_the_episode(
    constants: RssConstants, ticks: int
) -> None:
    monitor = LineMonitor(constants)
    monitor.update(5.0, line(3.0, RED))
    lasts = 0
    while monitor.critical:
        monitor.update(5.0, line(3.0, GREEN))
        lasts += 1
    assert lasts == ticks
    monitor.update(5.0, line(3.0, RED))
    monitor.reset()
    assert not monitor.critical
