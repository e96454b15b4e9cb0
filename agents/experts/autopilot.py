"""Autopilot: a rule-based expert with privileged sensors, used as demonstrator and as reference.

It follows its route's path by pure pursuit and takes the smallest of the accelerations that its rules ask for: the
speed limit and the curve ahead, leaders in its path (IDM), red and yellow lights, stop signs, and actors that cross or
join its path and have the right of way, or do not look like yielding. It passes what blocks its lane
(`passing`), and makes room for emergency vehicles and for traffic that crosses the middle of the road (`courtesy`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numba import njit
from pydantic import Field

from dohyo.agents.experts import gaps, impact
from dohyo.agents.experts.courtesy import (
    KEEP_RIGHT_RAMP_M,
    SQUEEZE_RAMP_M,
    YIELDING_M_S,
    EmergencyYielding,
    keep_right,
    squeeze_past,
    stand_before_oncoming,
)
from dohyo.agents.experts.gaps import PASSING_ACCELERATION
from dohyo.agents.experts.impact import Impact
from dohyo.agents.experts.passing import PASSING_M_S, Passing
from dohyo.agents.planning import surroundings
from dohyo.agents.planning.crossing import crossers
from dohyo.agents.planning.sidestep import Sidestep
from dohyo.agents.planning.stop_signs import NextStop
from dohyo.agents.planning.surroundings import Surroundings, ran_into_from_behind
from dohyo.agents.planning.turning import Turning
from dohyo.agents.planning.warm_up import empty_road
from dohyo.evaluation.agent import Agent, AgentSpec, Explanation, Mission, Observation
from dohyo.evaluation.settings import FieldsOf
from dohyo.sumo_networks.arrays import Float32Array
from dohyo.sumo_networks.ego.control import pure_pursuit, pursuit_distance
from dohyo.sumo_networks.ego.dynamics import VehicleParameters
from dohyo.sumo_networks.world import ActorKind, LightState

RED, YELLOW = int(LightState.RED), int(LightState.YELLOW)
PEDESTRIAN = int(ActorKind.PEDESTRIAN)
FREE = math.inf
NEAR_ENTRY_M = 15.0
HARD_BRAKING = 3.8
EAGER = 1.5
CREEPING_M_S = 2.0
MERGES = 0.8
"""Share of what is asked of the gap for a follower's speed that an ego in a hurry does without."""
LIMIT_M = 30


@dataclass(frozen=True, slots=True)
class Style:
    """How the autopilot drives.

    Attributes:
        max_speed: Upper bound under any speed limit, m/s.
        acceleration: m/s^2.
        comfortable_braking: m/s^2.
        lateral_acceleration: In curves, m/s^2.
        headway: Time gap to leaders, s.
        gap: Distance to a standing leader, m.
        line_gap: Front bumper to a stop line, m.
        corridor_margin: Width added on each side of the ego; an actor ahead within it is a leader, m.
        patience: After standing so long, the ego no longer waits for others that stand too, s.
        hurry_after: After waiting so long for a gap, the ego begins to take smaller ones, s.
        hurry_within: Time from then on until the ego takes the smallest gaps, s.
    """

    max_speed: Annotated[float, Field(gt=0, le=60)] = 14.0
    acceleration: Annotated[float, Field(gt=0, le=8)] = 2.0
    comfortable_braking: Annotated[float, Field(gt=0, le=8)] = 2.5
    lateral_acceleration: Annotated[float, Field(gt=0, le=8)] = 2.0
    headway: Annotated[float, Field(ge=0, le=10)] = 1.3
    gap: Annotated[float, Field(ge=0, le=50)] = 2.5
    line_gap: Annotated[float, Field(ge=0, le=20)] = 1.0
    corridor_margin: Annotated[float, Field(ge=0, le=5)] = 0.3
    patience: Annotated[float, Field(ge=0, le=3600)] = 12.0
    hurry_after: Annotated[float, Field(ge=0, le=3600)] = 8.0
    hurry_within: Annotated[float, Field(gt=0, le=3600)] = 30.0


class Autopilot(Agent):
    """The rule-based expert; its settings are the fields of `Style`.

    Source: IDM (Treiber, Hennecke, Helbing 2000) for gaps; gap acceptance and the braking rules are ours.
    """

    spec = AgentSpec(
        name="autopilot",
        track="privileged",
        sensors=("speedometer", "route", "objects", "junctions_ahead", "conflicts", "navigation", "path", "lanes"),
        control="acceleration_steering",
    )

    def __init__(self, **style: Annotated[float, FieldsOf(Style)]) -> None:
        self.style = Style(**style)
        self._vehicle = VehicleParameters()
        self._half_length, self._half_width = self._vehicle.length / 2, self._vehicle.width / 2
        self._reset_memory()

    def warm_up(self) -> None:
        """Decides on an empty road, and calls the kernels that such a road does not need."""
        for compiles in (surroundings.warm_up, gaps.warm_up, impact.warm_up):
            compiles()
        self.act(empty_road(self.spec.sensors))

    def reset(self, mission: Mission, seed: int) -> None:
        """Clears the state of the last episode."""
        self._reset_memory()

    def _reset_memory(self) -> None:
        self._standing, self._refused = 0.0, 0.0
        self._sign = NextStop()
        self._reason: Explanation = {}
        self._aside = Sidestep()
        self._passing = Passing(self._half_length, self._half_width)
        self._yielding = EmergencyYielding(self._half_length)
        self._impact, self._turning = Impact(self._half_length, self._half_width), Turning()
        self._right = 0.0

    def act(self, observation: Observation) -> np.ndarray:
        """Smallest requested acceleration, and steering along the path."""
        speed = float(observation["speedometer"][0])
        # Creeping up to a line counts as waiting; driving reduces the waiting time.
        self._standing = self._standing + 0.1 if speed < 0.6 else max(self._standing - 0.5, 0.0)
        around, progress = Surroundings(observation), float(observation["navigation"][2])
        self._step_aside(around, observation, speed, progress)
        route = self._aside.applied(observation["route"], progress)
        threats = self._passing.threats(around, speed, progress)
        wishes = {
            "free road": self._free_road(speed, route),
            "leader": self._leader(speed, self._leaders(observation["objects"], around, threats), route),
            "light": self._lights(speed, observation["junctions_ahead"]),
            "conflict": self._conflicts(speed, observation, around),
            "passing": self._wait_to_pass(speed),
            "oncoming": self._oncoming(around, threats, speed, progress),
            "emergency": self._yield(speed, observation["junctions_ahead"]),
        }
        most = PASSING_ACCELERATION if self._passing.active else self.style.acceleration + self._hurry
        wish = min(min(wishes.values()), most)
        turned = self._turning.update(observation["route"], speed)
        wishes["impact"] = self._impact.acceleration(observation["objects"], route, speed, wish, turned)
        cause = min(wishes, key=lambda name: wishes[name])
        refused = wishes["conflict"] < 0.1 and speed < 0.6
        self._refused = self._refused + 0.1 if refused else max(self._refused - 0.5, 0.0)
        self._reason = {"rule": cause, "acceleration": {name: round(a, 2) for name, a in wishes.items()}}
        acceleration = float(np.clip(wishes[cause], -8.0, most))
        return np.array([acceleration, self._steering(speed, route)])

    def explain(self) -> Explanation | None:
        """Deciding rule, and the acceleration that each rule requests."""
        return self._reason

    @property
    def _hurry(self) -> float:
        """Impatience in [0, 1]: after a long wait the ego takes smaller gaps and accelerates harder."""
        return min(max(self._refused - self.style.hurry_after, 0.0) / self.style.hurry_within, 1.0)

    def _steering(self, speed: float, route: Float32Array) -> float:
        aim = route[round(pursuit_distance(speed))]
        return pure_pursuit(self._vehicle, float(aim[0]), float(aim[1])) / self._vehicle.max_steering

    def _free_road(self, speed: float, route: Float32Array) -> float:
        """Acceleration towards the speed limit, with braking in time for lower limits and curves ahead."""
        s = self.style
        curve = np.sqrt(s.lateral_acceleration / np.maximum(np.abs(route[:, 3]), 1e-3))
        allowed = np.minimum(np.minimum(route[:, 4], curve), s.max_speed)
        ahead = np.arange(len(route), dtype=np.float64)
        # Speed now from which comfortable braking reaches each allowed speed in time.
        target = float(np.sqrt(allowed**2 + 2 * 0.7 * s.comfortable_braking * ahead).min())
        if speed > target:
            return max(-s.comfortable_braking * 1.6, (target - speed) / 0.5)
        if self._passing.active:
            return min(PASSING_ACCELERATION, (target - speed) / 0.5)
        return (s.acceleration + self._hurry) * (1.0 - (speed / max(target, 0.1)) ** 4)

    def _step_aside(self, around: Surroundings, observation: Observation, speed: float, progress: float) -> None:
        """Leaves the middle of the lane for blockers, emergency vehicles and oncoming traffic in this lane."""
        junctions, limit = observation["junctions_ahead"], float(observation["route"][:LIMIT_M, 4].min())
        if not self._yielding.active:
            self._passing.update(around, junctions, speed, limit, progress, self._aside)
        self._yielding.update(around, junctions, speed, progress, self._aside, self._passing)
        if self._passing.active or self._yielding.active:
            self._right = 0.0
            return
        wanted, ramp = keep_right(around, self._half_width, speed), KEEP_RIGHT_RAMP_M
        if junctions[0, 0] < 5.0:  # where turning vehicles look like oncoming traffic in this lane
            wanted = min(wanted, self._right)
        if self._standing > self.style.patience or (self._right > 0.0 and speed < CREEPING_M_S):
            wanted, ramp = max(wanted, squeeze_past(around, self._half_length, self._half_width)), SQUEEZE_RAMP_M
        if wanted > self._right + 0.05 or (wanted == 0.0 and self._right > 0.0):
            self._right = wanted
            self._aside.lead(-wanted, progress, ramp)

    def _leader(self, speed: float, objects: Float32Array, route: Float32Array) -> float:
        reach = self._half_width + self.style.corridor_margin
        gap, leader_speed = _leader(objects, route, reach, self._half_length)
        return self._follow(speed, gap, leader_speed)

    def _wait_to_pass(self, speed: float) -> float:
        """Stops far enough behind a blocker to turn out; limits the speed beside it."""
        if self._passing.active:
            return self._no_faster(speed, PASSING_M_S)
        if self._passing.waits_at == FREE:
            return FREE
        return self._stop_at(speed, self._passing.waits_at)

    def _leaders(self, objects: Float32Array, around: Surroundings, threats: set[int]) -> Float32Array:
        """Leaves out oncoming traffic that does not meet the ego while it passes a blocker."""
        passed = [one.key for one in around.driving() if one.opposes and one.key not in threats]
        if not (self._passing.active and passed):
            return objects
        return np.vstack([objects[~np.isin(objects[:, 7], passed)], np.full((1, objects.shape[1]), -1, np.float32)])

    def _oncoming(self, around: Surroundings, threats: set[int], speed: float, progress: float) -> float:
        return stand_before_oncoming(
            around, threats, self._half_length, self._half_width, lambda ahead: self._aside.at(progress + ahead), speed
        )

    def _yield(self, speed: float, junctions: Float32Array) -> float:
        """Drives slowly while an emergency vehicle passes, and enters no junction from the wrong lane."""
        if not self._yielding.active:
            return FREE
        wish = self._no_faster(speed, YIELDING_M_S)
        if self._aside.offset != 0.0 and 0.0 < junctions[0, 0] < 1000.0:
            wish = min(wish, self._stop_at(speed, float(junctions[0, 0])))
        return wish

    def _no_faster(self, speed: float, most: float) -> float:
        return max((most - speed) / 0.5, -self.style.comfortable_braking)

    def _can_stop(self, speed: float, distance: float) -> bool:
        """Whether it can stop before a line ahead without braking hard."""
        return 0.0 < distance < 1000.0 and speed**2 < 2 * 3.0 * distance

    def _follow(self, speed: float, gap: float, leader_speed: float) -> float:
        """IDM's interaction with a leader, or harder braking where that is needed to avoid the impact."""
        s = self.style
        if gap == FREE:
            return FREE
        gap = max(gap, 0.05)
        closing = speed * (speed - leader_speed) / (2 * math.sqrt(s.acceleration * s.comfortable_braking))
        wanted = s.gap + max(0.0, speed * s.headway + closing)
        idm = s.acceleration * (1.0 - (wanted / gap) ** 2)
        if speed > leader_speed:
            needed = (speed - leader_speed) ** 2 / (2 * max(gap - 0.8, 0.1))
            if needed > 3.5:
                return -needed * 1.3
        return max(idm, -5.0)

    def _stop_at(self, speed: float, distance: float) -> float:
        """Acceleration to stop with the front a little before a line."""
        return self._follow(speed, max(distance + self.style.gap - self.style.line_gap, 0.05), 0.0)

    def _lights(self, speed: float, junctions: Float32Array) -> float:
        """Stops at red lines, at yellow ones where that is comfortable, and once at every stop sign."""
        wish = FREE
        for distance, _, signal, _ in junctions:
            if distance < -0.5 or distance >= 1000.0:
                continue
            braking = speed**2 / (2 * max(float(distance) - 0.3, 0.1))
            if signal == RED or (signal == YELLOW and braking < 3.5):
                wish = min(wish, self._stop_at(speed, float(distance)))
        self._sign.update(speed, junctions)
        if self._sign.row >= 0 and not self._sign.stood:
            wish = min(wish, self._stop_at(speed, self._sign.distance))
        return wish

    def _conflicts(self, speed: float, observation: Observation, around: Surroundings) -> float:
        """Stops before the paths of traffic to yield to; before a junction rather than inside it."""
        wish = FREE
        entry, leave = (float(v) for v in observation["junctions_ahead"][0, :2])
        unforeseen = crossers(around, self._half_length, self._half_width)
        for row in np.concatenate([unforeseen, observation["conflicts"]]):
            if row[6] < 0:
                break
            if not self._must_wait(speed, row):
                continue
            distance = float(row[0]) - 0.5
            inside = entry < row[0] < min(leave, entry + NEAR_ENTRY_M)
            in_time = self._standing < self.style.patience and self._can_stop(speed, entry)
            if inside and in_time and row[6] != PEDESTRIAN:
                distance = entry
            wish = min(wish, self._stop_at(speed, distance))
        return wish

    def _must_wait(self, speed: float, row: Float32Array) -> bool:
        enter, leave, other_enter, other_leave, other_speed, priority, kind, _ = (float(v) for v in row)
        on_foot = kind == PEDESTRIAN
        if other_leave < 0.0:
            return False
        if enter < 0.3:
            # Already beside it. The ego lets others pass that are about to reach its side, if it has hardly moved.
            at_the_edge = speed < 1.5 if on_foot else speed < 2.5 and enter > -1.0 and other_speed > 5.0
            return at_the_edge and 0.0 < other_enter < 3.0 * other_speed
        if speed**2 / (2 * (enter - 0.2)) > 7.0 and not on_foot:
            return False  # too late to stop before it: clear it instead
        patience = self.style.patience if priority > 0 else self.style.patience / 4
        if other_speed < 0.3 and on_foot and other_enter > 0.5:
            return False
        if other_speed < 0.3 and other_enter > -2.0 and self._standing > patience:
            return False  # each waits for the other; the leader rule decides whether there is room
        arrive, clear = self._window(speed, enter, leave)
        other_clear = _latest(other_leave, other_speed)
        other_arrive = _earliest(other_enter, other_speed, kind, EAGER * (1.0 - 0.9 * self._hurry))
        if priority < 0:
            # The other must give way; doubt it when it could hardly stop any more, or is about to be there.
            braking = other_speed**2 / (2 * max(other_enter - 2.0, 0.1))
            doubtful = other_enter < max(0.8 * other_speed, 0.3) or (other_enter > 0.0 and braking > HARD_BRAKING)
            return doubtful and other_arrive < clear + 0.5 and arrive < other_clear + 0.3
        # After a long wait a smaller gap between vehicles will do.
        before, after = (1.2, 0.6) if on_foot else (1.5 - self._hurry, 1.0 - 0.5 * self._hurry)
        if leave >= 1000.0:
            # Followers must not have to brake hard; after a long wait they may have to brake at all.
            slower = max(other_speed - speed - 2.0, 0.0) * (1.0 - MERGES * self._hurry)
            before, clear = 2.0 + slower / 2.0, arrive + 0.5
        return other_arrive < clear + before and arrive < other_clear + after

    def _window(self, speed: float, enter: float, leave: float) -> tuple[float, float]:
        """Times when the ego's front enters a stretch and its rear leaves it, accelerating gently up to 8 m/s."""
        leave = min(leave, enter + 12.0 + 2 * self._half_length) + self.style.line_gap
        acceleration = EAGER + self._hurry
        return _travel_time(enter, speed, acceleration, 8.0), _travel_time(leave, speed, acceleration, 8.0)


def _travel_time(distance: float, speed: float, acceleration: float, top: float) -> float:
    """Time to cover a distance, accelerating up to a top speed, s."""
    top = max(top, speed)
    ramp = (top**2 - speed**2) / (2 * acceleration)
    if distance <= ramp:
        return (math.sqrt(speed**2 + 2 * acceleration * max(distance, 0.0)) - speed) / acceleration
    return (top - speed) / acceleration + (distance - ramp) / top


def _earliest(distance: float, speed: float, kind: float, acceleration: float) -> float:
    """Earliest arrival of another, s: vehicles may accelerate, pedestrians keep their speed."""
    if distance <= 0.0:
        return 0.0
    if kind == PEDESTRIAN:
        return distance / max(speed, 0.1)
    return _travel_time(distance, speed, acceleration, max(speed, 8.0))


def _latest(distance: float, speed: float) -> float:
    """Time when another has left, if it keeps its speed, s."""
    return distance / max(speed, 0.3)


@njit(cache=True)
def _leader(objects: Float32Array, route: Float32Array, reach: float, half_length: float) -> tuple[float, float]:
    """Nearest actor in the corridor around the path.

    Args:
        objects: (48, 8), see `sensors.objects`.
        route: (80, 7), see `sensors.route`.
        reach: Half the width of the corridor, m.
        half_length: Of the ego, m.

    Returns:
        Gap between bumpers [m], infinite without an actor, and its speed along the path [m/s].
    """
    best, best_speed = np.inf, 0.0
    ego_s = -route[0, 0] * math.cos(route[0, 2]) - route[0, 1] * math.sin(route[0, 2])
    for k in range(objects.shape[0]):
        if objects[k, 0] < 0:
            break
        x, y, heading, speed, length, width = objects[k, 1:7]
        if ran_into_from_behind(x, y, heading, length, half_length):
            continue
        cos, sin = math.cos(heading), math.sin(heading)
        nearest, gap, low, high = 1_000_000, math.inf, math.inf, -math.inf
        for a in (-0.5, 0.0, 0.5):
            for b in (-0.5, 0.0, 0.5):
                px, py = x + a * length * cos - b * width * sin, y + a * length * sin + b * width * cos
                i, distance = 0, math.inf
                for j in range(route.shape[0]):
                    d = (route[j, 0] - px) ** 2 + (route[j, 1] - py) ** 2
                    if d < distance:
                        i, distance = j, d
                if (i == 0 and px < 0.0) or i == route.shape[0] - 1:
                    continue
                along, left = math.cos(route[i, 2]), math.sin(route[i, 2])
                side = along * (py - route[i, 1]) - left * (px - route[i, 0])
                ahead = i - ego_s + along * (px - route[i, 0]) + left * (py - route[i, 1])
                low, high = min(low, side), max(high, side)
                nearest, gap = min(nearest, i), min(gap, ahead - half_length)
        if low > reach or high < -reach:
            continue
        if gap < best and nearest > 0:
            best = gap
            best_speed = max(speed * math.cos(heading - route[nearest, 2]), 0.0)
    return best, best_speed
