"""Scenario types: the 14 of nuPlan's planning challenge, each as a test of a recorded run.

nuPlan finds its types in logs of human drivers by tags, whose thresholds are not all public. The thresholds here are
ours. They were fixed before the benchmark was drawn and suit SUMO's traffic, which keeps to lanes. A run may be of
several types.

Source: nuPlan challenge 2023 (names); definitions ours.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType

import numpy as np

from dohyo.sumo_networks.arrays import BoolArray, FloatArray
from dohyo.sumo_networks.networks.network import RoadNetwork
from dohyo.sumo_networks.routes.command import Command
from dohyo.sumo_networks.routes.route import Route
from dohyo.sumo_networks.simulation.traffic_log import Log
from dohyo.sumo_networks.units import TICK_S
from dohyo.sumo_networks.world import ActorKind, Actors

HALF_LENGTH_M = 2.25
NEAR_M = 60.0
IN_PATH_M = 1.6
ENTERS_WITHIN_S = 6.0
TURN_RAD = np.radians(45.0)
THROUGH_M = 10.0
STOPPING_FROM_MPS, STOPPED_MPS, STOPPED_BEHIND_M = 4.0, 0.3, 10.0
LATERAL_MPS2, LATERAL_S = 1.5, 0.5
FAST_MPS, FAST_S = 9.0, 5.0
CRAWLING_MPS, CRAWLING_S = (0.3, 1.2), 1.0
KERB_M = (1.8, 5.0)
WAITING_MPS, WAITING_S, PEDESTRIAN_AHEAD_M, PEDESTRIAN_ASIDE_M = 0.5, 1.0, 15.0, 3.0
LONG_M, LONG_GAP_M, LONG_S = 8.0, 20.0, 3.0
STANDING_MPS, STANDING_S, STANDING_OTHERS, STANDING_WITHIN_M = 0.1, 5.0, 3, 30.0
CROWD, CROWD_WITHIN_M, CROWD_MPS, CROWD_S = 4, 20.0, 2.0, 1.0
CHANGE_WITHIN_M = 60.0
FOLLOWING_MPS, FOLLOWING_GAP_M, FOLLOWING_S = 3.5, 30.0, 5.0
_VEHICLES = (ActorKind.CAR, ActorKind.VAN, ActorKind.TRUCK, ActorKind.BUS, ActorKind.EMERGENCY)


@dataclass(frozen=True)
class Run:
    """Drive of one ego among other actors, in T ticks from tick 0.

    Attributes:
        network: Network of the drive.
        route: Route of the ego.
        log: Motion of all other actors.
        heading: (T,) heading of the ego, rad.
        speed: (T,) speed of the ego, m/s.
        position: (T, 2) centre of the ego's box, m.
        progress: (T,) progress of the ego along its route, m.
    """

    network: RoadNetwork
    route: Route
    log: Log
    heading: FloatArray
    speed: FloatArray
    position: FloatArray
    progress: FloatArray

    def actors(self, tick: int) -> Actors:
        """All other actors in one tick."""
        return self.log.actors(tick)

    @cached_property
    def lead(self) -> FloatArray:
        """(T, 3) gap [m], speed [m/s] and length [m] of the vehicle ahead in the ego's path; NaN if there is none."""
        out = np.full((len(self.speed), 3), np.nan)
        for tick in range(len(out)):
            actors, at = self.actors(tick), float(self.progress[tick])
            vehicle = np.isin(actors.kind, _VEHICLES)
            near = np.hypot(*(actors.position - self.position[tick]).T) < NEAR_M
            for i in np.flatnonzero(vehicle & near).tolist():
                s, aside, direction = self.route.project(*_point(actors, i), at, 0.0, NEAR_M)
                gap = s - at - HALF_LENGTH_M - 0.5 * actors.length[i]
                same_way = np.cos(actors.heading[i] - direction) > 0.5
                nearest = np.isnan(out[tick, 0]) or gap < out[tick, 0]
                if s > at and abs(aside) < IN_PATH_M and same_way and nearest:
                    out[tick] = gap, actors.speed[i], actors.length[i]
        return out


def _point(actors: Actors, row: int) -> tuple[float, float]:
    x, y = actors.position[row].tolist()
    return x, y


def _lasts(holds: BoolArray, seconds: float) -> bool:
    """Whether a condition holds for a duration without a break."""
    ticks = round(seconds / TICK_S)
    if len(holds) < ticks:
        return False
    return bool((np.convolve(holds.astype(np.int64), np.ones(ticks, dtype=np.int64), "valid") == ticks).any())


def _enters(run: Run, command: Command, lit: bool) -> bool:
    """Whether the ego's front enters a junction within 6 s of the start, and its route there has a given direction."""
    fronts = run.progress + HALF_LENGTH_M
    passage = next((one for one in run.route.passages if one.entry > fronts[0]), None)
    if passage is None or passage.command is not command or (lit and passage.signal < 0):
        return False
    inside = np.flatnonzero(fronts > passage.entry)
    return bool(len(inside) and inside[0] * TICK_S <= ENTERS_WITHIN_S and fronts[-1] >= passage.entry + THROUGH_M)


def _turned(run: Run) -> float:
    """Largest change of heading, rad, left positive."""
    change = np.unwrap(run.heading) - run.heading[0]
    return float(change[np.argmax(np.abs(change))])


def starting_left_turn(run: Run) -> bool:
    """The ego enters a junction within 6 s and turns left in it, by 45 degrees or more, 10 m or more into it."""
    return _enters(run, Command.LEFT, lit=False) and _turned(run) >= TURN_RAD


def starting_right_turn(run: Run) -> bool:
    """The same to the right."""
    return _enters(run, Command.RIGHT, lit=False) and _turned(run) <= -TURN_RAD


def starting_straight_traffic_light_intersection_traversal(run: Run) -> bool:
    """The ego enters a junction with a light within 6 s, goes straight on, and drives 10 m or more into it."""
    return _enters(run, Command.STRAIGHT, lit=True)


def stopping_with_lead(run: Run) -> bool:
    """From 4 m/s or more the ego comes to a stop (below 0.3 m/s) less than 10 m behind a vehicle in its path."""
    stops = (run.speed < STOPPED_MPS) & (run.lead[:, 0] < STOPPED_BEHIND_M)
    return bool(run.speed[0] >= STOPPING_FROM_MPS and stops.any())


def high_lateral_acceleration(run: Run) -> bool:
    """The ego's speed times its yaw rate is 1.5 m/s^2 or more for 0.5 s, to one side."""
    lateral = run.speed * np.gradient(np.unwrap(run.heading), TICK_S)
    return any(_lasts(side * lateral >= LATERAL_MPS2, LATERAL_S) for side in (1.0, -1.0))


def high_magnitude_speed(run: Run) -> bool:
    """The ego drives 9 m/s or more for the first 5 s."""
    return bool((run.speed[: round(FAST_S / TICK_S)] >= FAST_MPS).all())


def low_magnitude_speed(run: Run) -> bool:
    """The ego drives between 0.3 and 1.2 m/s for 1 s within the first 5 s."""
    first = run.speed[: round(FAST_S / TICK_S)]
    return _lasts((first >= CRAWLING_MPS[0]) & (first <= CRAWLING_MPS[1]), CRAWLING_S)


def traversing_pickup_dropoff(run: Run) -> bool:
    """The ego passes a vehicle that stands at the kerb, with its centre 1.8 to 5 m to the right of the ego's path."""
    # Scripted vehicles appear in the first tick after the start.
    first, last = run.actors(min(2, len(run.speed) - 1)), run.actors(len(run.speed) - 1)
    vehicles = np.isin(first.kind, (*_VEHICLES, ActorKind.STATIC)) & (first.speed < STANDING_MPS)
    for i in np.flatnonzero(vehicles).tolist():
        row = np.flatnonzero(last.key == first.key[i])
        stays = len(row) and np.hypot(*(last.position[row[0]] - first.position[i])) < 0.5
        s, aside, direction = run.route.project(*_point(first, i), float(run.progress[-1]) / 2, 1000.0, 1000.0)
        kerb = -KERB_M[1] <= aside <= -KERB_M[0] and np.cos(first.heading[i] - direction) > 0.9
        if stays and kerb and run.progress[0] < s < run.progress[-1]:
            return True
    return False


def waiting_for_pedestrian_to_cross(run: Run) -> bool:
    """The ego is below 0.5 m/s for 1 s with a pedestrian up to 15 m ahead of its front, up to 3 m beside its path."""
    waits = np.zeros(len(run.speed), dtype=np.bool_)
    for tick in np.flatnonzero(run.speed < WAITING_MPS):
        actors, front = run.actors(int(tick)), float(run.progress[tick]) + HALF_LENGTH_M
        for i in np.flatnonzero(actors.kind == ActorKind.PEDESTRIAN).tolist():
            s, aside, _ = run.route.project(*_point(actors, i), front, 0.0, PEDESTRIAN_AHEAD_M + 5.0)
            waits[tick] |= front < s <= front + PEDESTRIAN_AHEAD_M and abs(aside) <= PEDESTRIAN_ASIDE_M
    return _lasts(waits, WAITING_S)


def behind_long_vehicle(run: Run) -> bool:
    """A vehicle of 8 m or more is less than 20 m ahead in the ego's path for 3 s."""
    gap, _, length = run.lead.T
    return _lasts((gap < LONG_GAP_M) & (length >= LONG_M), LONG_S)


def stationary_in_traffic(run: Run) -> bool:
    """The ego stands (below 0.1 m/s) for the first 5 s, with 3 or more standing vehicles within 30 m."""
    actors = run.actors(0)
    standing = np.isin(actors.kind, _VEHICLES) & (actors.speed < STANDING_MPS)
    near = np.hypot(*(actors.position - run.position[0]).T) < STANDING_WITHIN_M
    stands = bool((run.speed[: round(STANDING_S / TICK_S)] < STANDING_MPS).all())
    return stands and int((standing & near).sum()) >= STANDING_OTHERS


def near_multiple_vehicles(run: Run) -> bool:
    """For 1 s, 4 or more vehicles are within 20 m of the ego, between centres, while it drives 2 m/s or more."""
    crowded = np.zeros(len(run.speed), dtype=np.bool_)
    for tick in range(len(crowded)):
        actors = run.actors(tick)
        near = np.hypot(*(actors.position - run.position[tick]).T) < CROWD_WITHIN_M
        crowded[tick] = (near & np.isin(actors.kind, _VEHICLES)).sum() >= CROWD
    return _lasts(crowded & (run.speed >= CROWD_MPS), CROWD_S)


def changing_lane(run: Run) -> bool:
    """The ego's route changes lane within 60 m of the start, and the ego completes the change."""
    return any(
        run.progress[0] <= change.start <= CHANGE_WITHIN_M and run.progress[-1] >= change.end
        for change in run.route.lane_changes
    )


def following_lane_with_lead(run: Run) -> bool:
    """For 5 s the ego and a vehicle less than 30 m ahead in its path both drive 3.5 m/s or more."""
    gap, speed, _ = run.lead.T
    follows = (run.speed >= FOLLOWING_MPS) & (speed >= FOLLOWING_MPS) & (gap < FOLLOWING_GAP_M)
    return _lasts(follows, FOLLOWING_S)


TYPES: Mapping[str, Callable[[Run], bool]] = MappingProxyType(
    {
        test.__name__.replace("_", "-"): test
        for test in (
            starting_left_turn,
            starting_right_turn,
            starting_straight_traffic_light_intersection_traversal,
            stopping_with_lead,
            high_lateral_acceleration,
            high_magnitude_speed,
            low_magnitude_speed,
            traversing_pickup_dropoff,
            waiting_for_pedestrian_to_cross,
            behind_long_vehicle,
            stationary_in_traffic,
            near_multiple_vehicles,
            changing_lane,
            following_lane_with_lead,
        )
    }
)
"""The test of every type, by the name of the type."""
