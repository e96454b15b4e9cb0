"""Reward functions by name."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from dohyo.sumo_networks.errors import UnknownNameError
from dohyo.sumo_networks.geometry import wrap_angle
from dohyo.sumo_networks.portable_math import arctan2
from dohyo.sumo_networks.rules.contacts import is_touched
from dohyo.sumo_networks.rules.red_signal import CLOSED, next_signal, passed_red
from dohyo.sumo_networks.rules.right_of_way import RightOfWay, duty, passages_within
from dohyo.sumo_networks.world import ActorKind, World


class Reward(Protocol):
    """A reward of one ego; one instance per ego and episode."""

    def __call__(self, before: World, after: World, ego: int) -> tuple[float, bool]:
        """The reward of one tick, and whether it ends the episode."""


@dataclass(slots=True)
class ProgressReward:
    """Distance along the route in the tick [m]; a contact costs 10 and ends the episode."""

    def __call__(self, before: World, after: World, ego: int) -> tuple[float, bool]:
        """Computes the reward of one tick; see `Reward`."""
        hit = is_touched(after, ego)
        return float(after.egos.progress[ego] - before.egos.progress[ego]) - 10.0 * hit, hit


@dataclass(slots=True)
class RoachReward:
    """The reward of Roach, as RLAD and RLfOLD use it: speed, position, rotation, action, termination.

    r = r_speed + r_position + r_rotation + r_action + r_termination, with the desired speed falling linearly to 0
    towards vehicles, pedestrians, red and yellow lights, stop signs and green right-turn arrows at which the ego has
    not stopped yet.

    Attributes:
        max_speed: Desired speed on a free road, m/s (6 in RLAD, 5 in RLfOLD).
        lateral_limit: Distance from the route that ends the episode, m.
        obey_lights: False for the NoCrash variant, which ignores lights and signs.

    Source: Zhang et al. 2021 (Roach); Coelho 2024, section 3.
    """

    max_speed: float = 6.0
    lateral_limit: float = 3.5
    obey_lights: bool = True
    _stood_before: float = field(default=-1.0, init=False, repr=False)

    def __call__(self, before: World, after: World, ego: int) -> tuple[float, bool]:
        """Computes the reward of one tick; see `Reward`."""
        egos = after.egos
        speed = float(egos.speed[ego])
        value = 1.0 - abs(speed - self.desired_speed(after, ego)) / self.max_speed
        value -= abs(float(egos.lateral[ego])) / 2
        value -= abs(float(egos.route_heading_error[ego]))
        value -= 0.1 * (abs(float(egos.steering[ego] - before.egos.steering[ego])) > 0.01)
        hit = is_touched(after, ego)
        ran = self.obey_lights and passed_red(before, after, ego)
        ended = hit or ran or abs(float(egos.lateral[ego])) > self.lateral_limit
        if ended:
            value -= 1.0 + (speed if hit or ran else 0.0)
        return value, ended

    def desired_speed(self, world: World, ego: int) -> float:
        """Desired speed of an expert, m/s."""
        share = 1.0
        vehicle, pedestrian = _hazards(world, ego)
        share = min(share, float(np.clip(vehicle - 8.0, 0.0, 5.0)) / 5)
        share = min(share, float(np.clip(pedestrian - 6.0, 0.0, 5.0)) / 5)
        if self.obey_lights:
            closed = min(_closed_line(world, ego), self._stop_sign(world, ego))
            share = min(share, float(np.clip(closed - 5.0, 0.0, 5.0)) / 5)
        return self.max_speed * share

    def _stop_sign(self, world: World, ego: int) -> float:
        """Distance from the ego's centre to a stop sign or arrow within 18 m, m; infinite if none or after a stop."""
        for ahead, passage in passages_within(world.routes[ego], float(world.egos.progress[ego]), LIGHT_M):
            if duty(world, passage) is RightOfWay.STOP:
                if ahead < STANDING_M and world.egos.speed[ego] < 0.1:
                    self._stood_before = passage.entry
                return math.inf if self._stood_before == passage.entry else ahead
        return math.inf


HAZARD_M = 9.5
LIGHT_M = 18.0
STANDING_M = 7.0


def _hazards(world: World, ego: int) -> tuple[float, float]:
    """Distances to the nearest hazardous vehicle and pedestrian, m; infinite if there is none."""
    egos, actors, lanes = world.egos, world.actors, world.network.lanes
    others = np.flatnonzero(egos.active & (np.arange(len(egos.names)) != ego))
    offset = np.concatenate([actors.position, egos.position[others]]) - egos.position[ego]
    heading = np.concatenate([actors.heading, egos.heading[others]])
    on_foot = np.concatenate([actors.kind == ActorKind.PEDESTRIAN, np.zeros(len(others), dtype=np.bool_)])
    lane = np.concatenate([actors.lane, np.full(len(others), -1)])
    distance = np.hypot(*offset.T)
    bearing = np.abs(wrap_angle(arctan2(offset[:, 1], offset[:, 0]) - egos.heading[ego]))
    turned = np.abs(wrap_angle(heading - egos.heading[ego]))
    vehicle = ~on_foot & (distance < HAZARD_M) & (bearing < math.radians(45)) & (turned <= math.radians(150))
    sidewalk = (lane >= 0) & lanes.pedestrian[lane] & ~lanes.crossing[lane] & ~lanes.drivable[lane]
    cone = np.radians(162.0 / (np.clip(distance, 1.5, 10.5) + 0.3))
    pedestrian = on_foot & ~sidewalk & (distance < HAZARD_M) & (bearing < cone)
    nearest = [float(distance[mask].min()) if mask.any() else math.inf for mask in (vehicle, pedestrian)]
    return nearest[0], nearest[1]


def _closed_line(world: World, ego: int) -> float:
    """Distance from the ego's centre to the next red or yellow signal within 18 m, m; infinite if there is none."""
    found = next_signal(world, ego, LIGHT_M)
    return found[0] if found is not None and found[1] in CLOSED else math.inf


REWARDS: dict[str, Callable[[], Reward]] = {"roach": RoachReward, "progress": ProgressReward}


def make_reward(name: str) -> Reward:
    """A reward function by name.

    Raises:
        UnknownNameError: No reward function has that name.
    """
    if name not in REWARDS:
        raise UnknownNameError("reward", name, REWARDS)
    return REWARDS[name]()
