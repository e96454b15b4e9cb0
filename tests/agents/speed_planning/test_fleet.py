from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from dohyo.agents.speed_planning.acc import Settings
from dohyo.agents.speed_planning.fleet import AccBased, Cars, Controller, Fleet, Limiter
from dohyo.agents.speed_planning.planner import SpeedPlan
from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.freeway.road import load_freeway
from dohyo.sumo_networks.freeway.world import FreewayWorld

ROAD = load_freeway("freeway")


def world(time_s: float = 100.0, **columns: Any) -> FreewayWorld:
    """Cars v0, v1, ... with these columns; the last is ahead."""
    position = np.asarray(columns["position_m"], dtype=np.float64)
    n = len(position)
    given: dict[str, Any] = {
        "names": tuple(f"v{k}" for k in range(n)),
        "lane": np.zeros(n, dtype=np.int64),
        "speed_mps": np.full(n, 20.0),
        "acceleration_mps2": np.zeros(n),
        "connected": np.ones(n, dtype=np.bool_),
        "fuel_mg_s": np.full(n, 1000.0),
    } | columns
    return FreewayWorld(
        road=ROAD, time_s=time_s, length_m=np.full(n, 5.0), probe=np.zeros(n, dtype=np.bool_),
        vtype=np.zeros(n, dtype=np.int64), **(given | {"position_m": position}),
    )  # fmt: skip


def plan(speed: float) -> SpeedPlan:
    state = np.full((5, 114), speed)
    return SpeedPlan(0.0, state, state, 100.0)


CONTROLLERS = pytest.mark.parametrize(
    ("controller", "acceleration_based"), [(Limiter(), 0.0), (AccBased(), 0.0), (AccBased(), 1.0)]
)


@CONTROLLERS
def test_alone_on_the_road_a_car_goes_to_the_plans_speed(controller: Controller, acceleration_based: float) -> None:
    fleet, speed = Fleet(0, controller, acceleration_based), 20.0
    for step in range(120):
        told = fleet.commands(world(100 + step / 2, position_m=[2000.0], speed_mps=np.array([speed])), plan(14.0))
        speed = float(np.clip(told["v0"], speed - 1.0, speed + 0.7))
    assert speed == pytest.approx(14.0, abs=0.2)


@CONTROLLERS
def test_near_a_leader_or_closing_in_fast_a_car_is_left_to_its_driver(
    controller: Controller, acceleration_based: float
) -> None:
    """A person opens a gap that a cut-in shortened, and meets a queue, more smoothly than the cruise control would."""
    fleet, linked = Fleet(0, controller, acceleration_based), np.array([True, False])
    near = world(position_m=[2000.0, 2013.0], speed_mps=np.array([10.0, 10.0]), connected=linked)
    closing = world(position_m=[2000.0, 2050.0], speed_mps=np.array([20.0, 0.0]), connected=linked)
    apart = world(position_m=[2000.0, 2050.0], speed_mps=np.array([20.0, 20.0]), connected=linked)
    assert fleet.commands(near, plan(30.0)) == {}
    assert fleet.commands(closing, plan(30.0)) == {}
    assert set(fleet.commands(apart, plan(30.0))) == {"v0"}


def test_a_limit_keeps_no_distance_and_the_cruise_control_does() -> None:
    """At 20 m/s and 25 m the cruise control falls back to its gap of 1.2 s; within a limit the driver decides."""
    now = world(position_m=[2000.0, 2030.0], connected=np.array([True, False]))
    limited, kept = (Fleet(0, one, 0.0).commands(now, plan(22.0))["v0"] for one in (Limiter(), AccBased()))
    assert kept < 20.0 < limited <= 22.0


def test_only_connected_cars_on_the_mainline_are_commanded() -> None:
    now = world(position_m=[2000.0, np.nan, 2500.0], lane=np.array([0, -1, 1]), connected=np.array([True, True, False]))
    assert set(Fleet(0).commands(now, plan(20.0))) == {"v0"}


def test_nobody_connected_is_nobody_commanded() -> None:
    assert Fleet(0).commands(world(position_m=[2000.0], connected=np.array([False])), plan(20.0)) == {}


def test_three_of_a_hundred_have_the_other_controller_and_keep_it() -> None:
    fleet = Fleet(1)
    n = 4000
    crowd = world(position_m=np.arange(n) * 2.5, lane=np.arange(n) % 4)
    fleet.commands(crowd, plan(20.0))
    kinds = dict(fleet._kind)
    fleet.commands(crowd, plan(10.0))
    assert fleet._kind == kinds
    assert np.mean(list(kinds.values())) == pytest.approx(0.03, abs=0.012)


class Listed:
    """Keeps the names of the cars that it gets."""

    def __init__(self) -> None:
        self.names: set[str] = set()

    def speeds(self, cars: Cars) -> FloatArray:
        self.names |= set(cars.names)
        return cars.speed


def test_a_car_has_its_controller_whatever_other_cars_there_are() -> None:
    listed = []
    for first in (0, 1):
        listed.append(Listed())
        names = tuple(f"v{k}" for k in range(first, 200))
        crowd = world(names=names, position_m=50.0 * np.arange(len(names)))
        Fleet(1, listed[-1], acceleration_based=0.5).commands(crowd, plan(20.0))
    assert listed[0].names - {"v0"} == listed[1].names
    assert 70 < len(listed[1].names) < 130


class Seen:
    """Set-points that rise from decision to decision; keeps the observations."""

    def __init__(self) -> None:
        self.observations: list[FloatArray] = []

    def settings(self, observation: FloatArray) -> Settings:
        self.observations.append(observation)
        return Settings(np.array([10.0 + len(self.observations)]), np.array([2.0]))


def test_a_policy_sees_what_its_last_settings_led_to_as_in_its_training() -> None:
    """In `PlatoonEnv` a decision's pair has the speed after it, and the newest acceleration is the one during it."""
    policy = Seen()
    fleet = Fleet(0, AccBased(policy), acceleration_based=0.0)  # type: ignore[arg-type]
    for step, speed in enumerate((20.0, 21.0, 23.0)):
        faster = np.array([(0.0, 2.0, 4.0)[step]])
        now = world(100 + step / 2, position_m=[2000.0], speed_mps=np.array([speed]), acceleration_mps2=faster)
        fleet.commands(now, plan(30.0))
    first, _, last = (observation[0] for observation in policy.observations)
    assert first[1:6].tolist() == [0.0] * 5
    assert last[1:6] == pytest.approx([1.0, 0.5, 0.0, 0.0, 0.0])
    assert 40.0 * last[14:20] == pytest.approx([23.0, 12.0, 21.0, 11.0, 20.0, 20.0])


def test_memory_follows_the_car_when_others_come_and_go() -> None:
    acc = AccBased()
    fleet = Fleet(0, acc, acceleration_based=0.0)
    fleet.commands(world(100.0, position_m=[1000.0, 2000.0], speed_mps=np.array([11.0, 22.0])), plan(20.0))
    fleet.commands(
        world(100.5, names=("v1", "v9"), position_m=[2011.0, 3000.0], speed_mps=np.array([23.0, 9.0])), plan(20.0)
    )
    assert acc._rows.speeds[0, :3].tolist() == [23.0, 22.0, 22.0]
    assert acc._rows.speeds[1, :3].tolist() == [9.0, 9.0, 9.0]


def test_a_share_that_is_none_is_refused() -> None:
    with pytest.raises(InvalidInputError, match=r"share in \[0, 1\], got 3"):
        Fleet(0, acceleration_based=3.0)
