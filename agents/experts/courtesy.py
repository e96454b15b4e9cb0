"""Courtesy: makes room for emergency vehicles, and for oncoming traffic in the ego's lane."""

from __future__ import annotations

import math
from collections.abc import Callable

from dohyo.agents.experts.passing import Passing
from dohyo.agents.planning.sidestep import RAMP_M, Sidestep
from dohyo.agents.planning.surroundings import LaneBeside, Neighbour, Surroundings
from dohyo.sumo_networks.arrays import Float32Array
from dohyo.sumo_networks.world import ActorKind

FREE = math.inf
SIREN_M = 90.0
JUNCTION_M = 20.0
YIELDING_M_S = 5.0
PASSED_M = 8.0
SIGHT_S = 6.0
ONCOMING_CLEARANCE_M = 0.25
KERB_M = 0.1
KEEP_RIGHT_RAMP_M = 8.0
SQUEEZE_RAMP_M = 3.0
SQUEEZE_CLEARANCE_M = 0.4
SQUEEZE_M = 1.2
NOSE_M = 8.0


class EmergencyYielding:
    """Lets an emergency vehicle pass: moves into the lane beside, slowly, until it is past.

    Attributes:
        active: Whether an emergency vehicle is near.
    """

    def __init__(self, half_length: float) -> None:
        self._half_length = half_length
        self.active = False

    def update(
        self,
        around: Surroundings,
        junctions: Float32Array,
        speed: float,
        progress: float,
        aside: Sidestep,
        room: Passing,
    ) -> None:
        """Updates by one tick, and sets the sidestep."""
        coming = any(self._needs_way(one) for one in around.neighbours)
        if self.active and not coming and (aside.offset == 0.0 or room.may_return(around, speed)):
            aside.back(progress)
            self.active = False
        if not coming or room.active:
            return
        self.active = True
        if aside.offset != 0.0 or any(
            e < JUNCTION_M and 0.0 < e2 < 1000.0 and e2 - e > 1.0 for e, e2, _, _ in junctions
        ):
            return
        lanes = [lane for lane in around.lanes_beside(0.0, 25.0) if not lane.oncoming]
        for lane in sorted(lanes, key=lambda lane: lane.d):
            if self._free(around, lane, speed, room):
                aside.lead(lane.d, progress, RAMP_M)
                return

    def _needs_way(self, one: Neighbour) -> bool:
        near = one.s_high > -SIREN_M and one.s_low < self._half_length + PASSED_M
        return one.kind == ActorKind.EMERGENCY and near and one.along > 0.5 and one.within(-1.5, 1.5)

    def _free(self, around: Surroundings, lane: LaneBeside, speed: float, room: Passing) -> bool:
        others = (one for one in around.driving() if one.along > 0.0 and one.kind != ActorKind.EMERGENCY)
        return not any(room.in_the_way(one, lane.d, speed, 1.0) for one in others)


def keep_right(around: Surroundings, half_width: float, speed: float) -> float:
    """Offset to the right that gives room to oncoming traffic in the ego's lane, m."""
    most = max(0.5 * around.lane_width - half_width - KERB_M, 0.0)
    wanted = 0.0
    for one in around.driving():
        near = one.oncoming and -half_width < one.s_high and one.s_low < (speed + one.speed) * SIGHT_S
        if near and one.within(-half_width, half_width + ONCOMING_CLEARANCE_M):
            wanted = max(wanted, half_width + 2 * ONCOMING_CLEARANCE_M - one.d_low)
    return min(wanted, most)


def squeeze_past(around: Surroundings, half_length: float, half_width: float) -> float:
    """Offset to the right that passes an oncoming vehicle that stands and waits for the ego too, m.

    A vehicle that turns left may stand with its front in the ego's path; both would then wait for ever.
    """
    wanted = 0.0
    for one in around.driving():
        facing = one.stands and one.along < 0.0 and half_length - 0.5 < one.s_low < half_length + NOSE_M
        if facing and one.d_high > half_width and one.within(-half_width, half_width + SQUEEZE_CLEARANCE_M):
            wanted = max(wanted, half_width + SQUEEZE_CLEARANCE_M - one.d_low)
    return wanted if wanted <= SQUEEZE_M else 0.0


def stand_before_oncoming(
    around: Surroundings,
    threats: set[int],
    half_length: float,
    half_width: float,
    aside: Callable[[float], float],
    speed: float,
) -> float:
    """Acceleration that stops the ego before it meets oncoming traffic on its own path, m/s^2.

    Args:
        around: Actors and lanes.
        threats: Keys of the actors that count.
        half_length: Of the ego, m.
        half_width: Of the ego, m.
        aside: How far to the left of the route it will be [m], by metres ahead.
        speed: Of the ego, m/s.
    """
    wish = FREE
    for one in around.driving():
        if one.key not in threats or one.s_low < half_length:
            continue
        gap = one.s_low - half_length
        # At the place of meeting, the ego may be back in its lane.
        offset = aside(half_length + gap * speed / max(speed + one.speed, 0.1))
        if not one.within(offset - half_width - ONCOMING_CLEARANCE_M, offset + half_width + ONCOMING_CLEARANCE_M):
            continue
        # The other one approaches until the ego stands; then 3 m should be left.
        needed = speed * (0.5 * speed + one.speed) / max(gap - 3.0 - 0.3 * (speed + one.speed), 0.1)
        if needed > 1.0 or gap < 2.0 * (speed + one.speed):
            wish = min(wish, -max(1.2 * needed, 2.0))
    return wish
