from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np
import pytest
import torch

from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.ego.control import (
    CONTROLS,
    WAYPOINT_COUNT,
    WAYPOINT_INTERVAL_S,
    Control,
    InvalidActionError,
    make_control,
    pure_pursuit,
)
from dohyo.sumo_networks.ego.dynamics import HEADING, SPEED, VehicleParameters, Vehicles
from dohyo.sumo_networks.errors import AgentError, UnknownNameError
from dohyo.sumo_networks.routes.route import Route
from dohyo.sumo_networks.units import TICK_S
from dohyo.sumo_networks.world import World
from tests.worlds import straight_road

CAR = VehicleParameters()
STANDING = straight_road().with_ego(x=50.0).world()
Act = Callable[[World], FloatArray]


def made(name: str) -> Control:
    return make_control(name, CAR, TICK_S)


def followed(control: Control, act: Act, world: World, seconds: float) -> list[World]:
    """Worlds in which one car, and nothing else, does what the control says."""
    vehicles, route, worlds = Vehicles(CAR, 1), world.routes[0], [world]
    vehicles.place(0, *world.egos.position[0].tolist(), float(world.egos.heading[0]))
    vehicles.states[0, SPEED] = world.egos.speed[0]
    for _ in range(round(seconds / TICK_S)):
        egos = worlds[-1].egos
        vehicles.advance(np.array([control.command(act(worlds[-1]), worlds[-1], 0)]), TICK_S)
        centre = vehicles.centres()
        progress, lateral, _ = route.project(*centre[0].tolist(), float(egos.progress[0]))
        egos = dataclasses.replace(
            egos,
            position=centre,
            heading=vehicles.states[:, HEADING].copy(),
            speed=vehicles.states[:, SPEED].copy(),
            progress=np.array([progress]),
            lateral=np.array([lateral]),
        )
        worlds.append(dataclasses.replace(worlds[-1], egos=egos))
    return worlds


def circling(radius: float, speed: float, left: float = 0.0) -> World:
    """An ego at the start of a circular route, so far to its left."""
    scene = straight_road()
    angle = np.arange(0.0, 1000.0) / radius
    route: Route = dataclasses.replace(
        scene.route,
        length=999.0,
        position=np.column_stack([500 + radius * np.sin(angle), radius * (1 - np.cos(angle))]),
        heading=angle.copy(),
        curvature=np.full(1000, 1 / radius),
        width=np.full(1000, 3.2),
    )
    world = scene.with_ego(x=500.0, y=left, speed=speed).world()
    egos = dataclasses.replace(world.egos, progress=np.zeros(1), lateral=np.array([left]))
    return dataclasses.replace(world, routes=(route,), egos=egos)


def along_the_route(speed: float) -> Act:
    """Waypoints on the route, driven through at a speed."""

    def act(world: World) -> FloatArray:
        egos, route = world.egos, world.routes[0]
        s = egos.progress[0] + speed * WAYPOINT_INTERVAL_S * np.arange(1, WAYPOINT_COUNT + 1)
        rows = np.clip(s * (len(route.position) - 1) / route.length, 0, len(route.position) - 1)
        offset = np.column_stack(
            [np.interp(rows, np.arange(len(route.position)), route.position[:, i]) for i in (0, 1)]
        )
        offset -= egos.position[0]
        cos, sin = math.cos(egos.heading[0]), math.sin(egos.heading[0])
        return np.array(offset @ np.array([[cos, -sin], [sin, cos]]))

    return act


# What is an action


@pytest.mark.parametrize("name", CONTROLS)
def test_values_beyond_the_bounds_are_clipped(name: str) -> None:
    control = made(name)
    low, high = control.space.low, control.space.high
    np.testing.assert_array_equal(control.checked(high + 1000.0), high)
    np.testing.assert_array_equal(control.checked(low - 1000.0), low)
    assert made(name).command(high + 1000.0, STANDING, 0) == made(name).command(high, STANDING, 0)
    assert made(name).command(low - 1000.0, STANDING, 0) == made(name).command(low, STANDING, 0)


class Trap:
    """Fails as soon as anybody looks at it."""

    def __array__(self, *args: object) -> FloatArray:
        raise RuntimeError("caught")

    def __repr__(self) -> str:
        raise RuntimeError("caught")


def wrong(kind: str, shape: tuple[int, ...]) -> object:
    good = np.zeros(shape)
    return {
        "nothing": None,
        "a number": 0.5,
        "too short": good[:-1],
        "too long": np.zeros((shape[0] + 1, *shape[1:])),
        "one more axis": good[None],
        "empty": [],
        "NaN": np.full(shape, math.nan),
        "infinity": np.full(shape, math.inf),
        "one NaN": np.where(np.arange(good.size).reshape(shape) == 0, math.nan, 0.0),
        "text": "0.5",
        "numbers as text": np.full(shape, "0.5").tolist(),
        "bytes": np.full(shape, b"0"),
        "objects": np.full(shape, None),
        "ragged": [[0.0], [0.0, 0.0], 1.0],
        "complex": good + 1j,
        "dates": good.astype("datetime64[s]"),
        "a number too large": np.full(shape, 10**400, dtype=object),
        "a dictionary": {"throttle": 1.0},
        "a trap": Trap(),
        "a tensor with gradients": torch.zeros(shape, requires_grad=True),
    }[kind]


WRONG = (
    *("nothing", "a number", "too short", "too long", "one more axis", "empty", "NaN", "infinity", "one NaN", "text"),
    *("numbers as text", "bytes", "objects", "ragged", "complex", "dates", "a number too large", "a dictionary"),
    *("a trap", "a tensor with gradients"),
)


@pytest.mark.parametrize("kind", WRONG)
@pytest.mark.parametrize("name", CONTROLS)
def test_what_is_no_action_is_the_agents_fault(name: str, kind: str) -> None:
    control = made(name)
    with pytest.raises(InvalidActionError) as error:
        control.command(wrong(kind, control.space.shape), STANDING, 0)
    assert isinstance(error.value, AgentError)
    assert "expected" in str(error.value)
    assert len(str(error.value)) < 250


@pytest.mark.parametrize("name", CONTROLS)
def test_lists_integers_and_tensors_are_actions_too(name: str) -> None:
    control = made(name)
    zeros = np.zeros(control.space.shape, dtype=np.int64)
    for action in (zeros, zeros.astype(np.float32), zeros.tolist(), torch.zeros(control.space.shape)):
        np.testing.assert_array_equal(control.checked(action), zeros)


def test_an_unknown_control_gets_the_nearest_name() -> None:
    with pytest.raises(UnknownNameError, match="did you mean 'waypoints'"):
        make_control("waypoint", CAR, TICK_S)


# What the controls demand


def test_pedals_and_steering_are_shares_of_what_the_car_can() -> None:
    control = made("pedals_steering")
    assert control.command([1, 0, 0], STANDING, 0) == (CAR.max_traction, 0.0)
    assert control.command([0, 1, 0], STANDING, 0) == (-CAR.max_braking, 0.0)
    assert control.command([0, 0, -1], STANDING, 0) == (0.0, -CAR.max_steering)
    fast = straight_road().with_ego(x=50.0, speed=30.0).world()
    assert control.command([0.5, 0, 0.5], fast, 0) == pytest.approx((0.5 * 65.0 / 30.0, 0.5 * CAR.max_steering))


@pytest.mark.parametrize("speed", [0.0, 5.0, 20.0])
@pytest.mark.parametrize("wish", [-3.0, 0.0, 1.5])
def test_the_car_accelerates_as_asked(speed: float, wish: float) -> None:
    world = straight_road().with_ego(x=50.0, speed=speed).world()
    worlds = followed(made("acceleration_steering"), lambda world: np.array([wish, 0.0]), world, 1.5)
    reached = (worlds[-1].egos.speed[0] - worlds[5].egos.speed[0]) / 1.0
    assert reached == pytest.approx(wish if speed + 1.5 * wish > 0 else 0.0, abs=0.08)


@pytest.mark.parametrize("start", [0.0, 5.0, 20.0])
@pytest.mark.parametrize("target", [0.0, 3.0, 8.0, 15.0])
@pytest.mark.parametrize("name", ["target_speed_steering", "lane_command"])
def test_the_target_speed_is_reached_and_held(name: str, target: float, start: float) -> None:
    world = straight_road().with_ego(x=50.0, speed=start).world()
    speed = [float(w.egos.speed[0]) for w in followed(made(name), lambda w: np.array([target, 0.0]), world, 25.0)]
    assert speed[150:] == pytest.approx([target] * 101, abs=0.3)
    overshoot = max(v - target for v in speed) if start <= target else max(target - v for v in speed)
    assert overshoot < 0.6


def test_a_control_starts_every_episode_anew() -> None:
    used, fresh = made("target_speed_steering"), made("target_speed_steering")
    for _ in range(50):
        used.command([10.0, 0.0], STANDING, 0)
    again = made("target_speed_steering")
    assert again.command([10.0, 0.0], STANDING, 0) == fresh.command([10.0, 0.0], STANDING, 0)
    assert used.command([10.0, 0.0], STANDING, 0) != again.command([10.0, 0.0], STANDING, 0)


def test_after_a_stop_the_car_sets_off_as_if_for_the_first_time() -> None:
    control = made("target_speed_steering")
    for _ in range(50):
        control.command([10.0, 0.0], STANDING, 0)
    assert control.command([0.0, 0.0], STANDING, 0)[0] < -1.0, "the brake holds it"
    assert control.command([10.0, 0.0], STANDING, 0) == made("target_speed_steering").command([10.0, 0.0], STANDING, 0)


@pytest.mark.parametrize(("x", "y"), [(10.0, 0.0), (10.0, 3.0), (6.0, -4.0)])
def test_pure_pursuit_leads_through_the_point(x: float, y: float) -> None:
    steering = pure_pursuit(CAR, x, y)
    assert math.copysign(1, steering) == math.copysign(1, y) or y == 0
    if y:
        # The circle about the rear axle, of the radius this steering gives, passes through the point.
        radius = CAR.wheelbase / math.tan(steering)
        assert math.hypot(x + CAR.axle_to_centre, y - radius) == pytest.approx(abs(radius), rel=1e-9)
    else:
        assert steering == 0.0


# Along a path


def lane_command(speed: float) -> Act:
    return lambda world: np.array([speed, 0.0])


@pytest.mark.parametrize(("name", "agent"), [("waypoints", along_the_route), ("lane_command", lane_command)])
@pytest.mark.parametrize("speed", [3.0, 8.0, 13.0])
def test_a_straight_path_is_kept(name: str, agent: Callable[[float], Act], speed: float) -> None:
    world = straight_road().with_ego(x=50.0, speed=speed, left=1.0).world()
    worlds = followed(made(name), agent(speed), world, 20.0)
    lateral = [abs(float(w.egos.lateral[0])) for w in worlds]
    assert max(lateral) <= 1.05
    assert max(lateral[80:]) < 0.1
    assert worlds[-1].egos.speed[0] == pytest.approx(speed, abs=0.3)
    assert worlds[-1].egos.progress[0] > 50 + 0.95 * 20 * speed


@pytest.mark.parametrize(("name", "agent"), [("waypoints", along_the_route), ("lane_command", lane_command)])
@pytest.mark.parametrize(("radius", "speed"), [(10.0, 4.0), (30.0, 8.0), (60.0, 12.0), (-30.0, 8.0)])
def test_a_circle_is_kept(name: str, agent: Callable[[float], Act], radius: float, speed: float) -> None:
    worlds = followed(made(name), agent(speed), circling(radius, speed), 20.0)
    assert max(abs(float(w.egos.lateral[0])) for w in worlds) < 0.5
    assert worlds[-1].egos.progress[0] > 0.9 * 20 * speed


@pytest.mark.parametrize("lane", [-1, 1])
def test_a_lane_command_moves_over_by_a_lane(lane: int) -> None:
    world = straight_road().with_ego(x=50.0, speed=8.0).world()
    worlds = followed(made("lane_command"), lambda world: np.array([8.0, lane]), world, 10.0)
    assert worlds[-1].egos.lateral[0] == pytest.approx(lane * 3.2, abs=0.1)


@pytest.mark.parametrize(("near", "lane"), [(0.4, 0), (-0.4, 0), (0.6, 1), (-0.9, -1)])
def test_lanes_between_are_rounded(near: float, lane: int) -> None:
    commands = [made("lane_command").command([5.0, value], STANDING, 0) for value in (near, float(lane))]
    assert commands[0] == commands[1]


def test_waypoints_at_the_ego_mean_stop() -> None:
    world = straight_road().with_ego(x=50.0, speed=6.0).world()
    worlds = followed(made("waypoints"), lambda world: np.zeros((8, 2)), world, 6.0)
    assert worlds[-1].egos.speed[0] == 0.0
    assert abs(worlds[-1].egos.lateral[0]) < 1e-6
