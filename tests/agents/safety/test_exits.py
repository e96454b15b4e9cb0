"""Exits: a junction is closed while what stands behind it leaves the ego no room, and not for ever."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dohyo.agents.planning.surroundings import Neighbour
from dohyo.agents.safety.exits import PATIENCE_S, ExitMonitor, without_room
from dohyo.sumo_networks.arrays import Float32Array
from dohyo.sumo_networks.ego.dynamics import VehicleParameters
from dohyo.sumo_networks.world import ActorKind, LightState

EGO = VehicleParameters()
FAR = [1000.0, 1000.0, -1.0, 0.0]
GREEN = float(LightState.GREEN)


def junction(entry: float, length: float = 15.0) -> Float32Array:
    return np.array([[entry, entry + length, GREEN, 0.0], FAR, FAR, FAR], dtype=np.float32)


def car(rear: float, speed: float, d: float = 0.0) -> Neighbour:
    """A car whose rear is so far before the ego's front."""
    low = EGO.length / 2 + rear
    return Neighbour(int(ActorKind.CAR), round(10 * rear), low, low + 4.5, d - 0.9, d + 0.9, speed, 1.0, 0.0)


def closed(speed: float, *cars: Neighbour, entry: float = 10.0) -> bool:
    return bool(without_room(speed, junction(entry), cars)[0])


def test_a_queue_that_reaches_into_the_junction_or_ends_right_behind_it_closes_it() -> None:
    assert closed(4.0, car(20.0, 0.0))
    assert closed(4.0, car(28.0, 0.5))
    assert not closed(4.0, car(35.0, 0.0)), "room for the ego"
    assert not closed(4.0), "no queue"


def test_those_between_the_ego_and_the_queue_take_the_room_first() -> None:
    assert not closed(4.0, car(35.0, 0.0))
    assert closed(4.0, car(16.0, 6.0), car(35.0, 0.0))
    assert closed(4.0, car(2.0, 4.0), car(35.0, 0.0)), "before the line, and about to enter"


def test_traffic_that_flows_a_lane_beside_and_a_queue_before_the_line_close_nothing() -> None:
    assert not closed(6.0, car(12.0, 7.0), car(22.0, 8.0))
    assert not closed(4.0, car(20.0, 0.0, d=3.2))
    assert not closed(2.0, car(1.0, 0.0)), "the ego stands behind it anyway"


def test_an_ego_that_can_no_longer_stop_or_is_inside_drives_on() -> None:
    assert not closed(10.0, car(20.0, 0.0))
    assert not closed(0.0, car(3.0, 0.0), entry=-2.0)


@given(st.floats(0.0, 8.0), st.floats(0.5, 60.0), st.floats(0.0, 60.0))
def test_more_room_never_closes_a_junction(speed: float, entry: float, rear: float) -> None:
    near, far = (closed(speed, car(entry + at, 0.0), entry=entry) for at in (rear, rear + 5.0))
    assert near or not far


def test_the_line_is_red_while_it_waits_and_the_light_of_before_once_it_has_waited_long() -> None:
    monitor, line, queue = ExitMonitor(), junction(1.5), [car(10.0, 0.0)]
    told = monitor.update(0.0, line, queue)
    assert told[0].tolist() == [*line[0, :2].tolist(), float(LightState.RED), 0.0]
    assert line[0, 2] == GREEN, "what was given stays"
    for _ in range(round(10 * PATIENCE_S)):
        told = monitor.update(0.0, line, queue)
    assert told is line
    assert not monitor.waits
    assert monitor.update(0.0, line, []) is line
    assert monitor.update(0.0, line, queue)[0, 2] == LightState.RED, "another queue, another wait"


@pytest.mark.parametrize("speed", [1.0, 5.0])
def test_waiting_counts_only_while_it_stands(speed: float) -> None:
    monitor = ExitMonitor()
    for _ in range(round(20 * PATIENCE_S)):
        monitor.update(speed, junction(10.0), [car(20.0, 0.0)])
    assert monitor.waits
