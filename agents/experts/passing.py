"""Passing: goes round what blocks the ego's lane, through the lane beside it, or the oncoming one, in a gap."""

from __future__ import annotations

import math
from dataclasses import dataclass

from agents.experts.blockers import Blocker, Patience, find_blocker
from agents.experts.sidestep import RAMP_M, Sidestep
from agents.experts.surroundings import Lane, Neighbour, Surroundings
from sumo_networks.arrays import Float32Array

FREE = math.inf
PASSING_M_S = 10.0
PASSING_ACCELERATION = 3.0
CLEARANCE_M = 0.5
LEAST_CLEARANCE_M = 0.3
RUN_UP_M = 8.0
LONG_RUN_UP_M = 14.0
LONG_M = 12.0
TURN_OUT_M = 4.0
LEAST_RAMP_M = 6.0
HURRY_S = 40.0
MARGIN_M = 4.0
LAG_S = 0.2
REACTION_S = 1.0
CLAIM_S = 60.0
LATERAL_M_S2 = 3.0
NOT_YET_OUT_M = 0.8
FOLLOWER_BRAKING = 3.0


@dataclass(frozen=True, slots=True)
class Way:
    """A way round a blocker.

    Attributes:
        offset: m to the left of the route.
        oncoming: Whether it uses the oncoming lane.
    """

    offset: float
    oncoming: bool


class Passing:
    """Decides when to leave the middle of the lane for a blocker, and when to go back.

    Attributes:
        waits_at: Where the ego has to wait for a gap, m from its front; infinite where it need not.
        active: Whether it is passing.
    """

    def __init__(self, half_length: float, half_width: float) -> None:
        self._half_length, self._half_width = half_length, half_width
        self._patience = Patience()
        self._waited, self._claims = 0.0, False
        self._end, self._way, self._blocker = 0.0, Way(0.0, False), Blocker(0.0, 0.0, 0.0, 0.0, 0.0)
        self.active, self.waits_at = False, FREE

    def update(
        self, around: Surroundings, lights: Float32Array, speed: float, progress: float, aside: Sidestep
    ) -> None:
        """Goes on for one tick; leads the sidestep."""
        self._patience.watch(around.neighbours)
        self.waits_at = FREE
        reach = self._half_width + LEAST_CLEARANCE_M
        behind = -self._half_length if self.active else self._half_length
        blocker, decided = find_blocker(around, lights, self._patience, reach, behind)
        if self.active:
            self._go_on(around, blocker, speed, progress, aside)
            return
        if blocker is None:
            self._waited, self._claims = 0.0, False
            return
        gap = blocker.first - self._half_length
        run_up = LONG_RUN_UP_M if blocker.last - blocker.first > LONG_M else RUN_UP_M
        if not decided:
            # Whoever may be parked is kept room from; who was just driving is followed.
            self.waits_at = gap - run_up
            return
        if gap < 0.5:
            return
        for way in self._ways(around, blocker):
            ramp = self._ramp(way, gap, speed)
            if ramp is not None and self.has_room(around, way, blocker, speed, ramp):
                aside.lead(way.offset, progress + max(gap - 1.0 - ramp, 0.0), ramp)
                self.active, self._way, self._blocker, self._waited = True, way, blocker, 0.0
                self._end = progress + blocker.last + self._half_length
                return
        if blocker.speed == 0.0:
            self._waited += 0.1
            self._claims = self._waited > CLAIM_S
            self.waits_at = gap - run_up

    @staticmethod
    def _ramp(way: Way, gap: float, speed: float) -> float | None:
        """Length of the turn out, m; None where there is too little room for it at this speed."""
        gentle = speed * math.sqrt(6.0 * abs(way.offset) / LATERAL_M_S2)
        return None if 0.9 * gentle > gap else min(max(gentle, LEAST_RAMP_M), max(gap - 1.0, LEAST_RAMP_M))

    def _go_on(
        self, around: Surroundings, blocker: Blocker | None, speed: float, progress: float, aside: Sidestep
    ) -> None:
        if blocker is not None and blocker.first < self._end - progress + 2 * RAMP_M:
            self._end = max(self._end, progress + blocker.last + self._half_length)
            self._blocker = blocker
        if (
            self._way.oncoming
            and self.threats(around, speed, progress)
            and abs(aside.at(progress)) < NOT_YET_OUT_M < abs(aside.offset)
        ):
            aside.back(progress, LEAST_RAMP_M)
            self.active = False
        elif progress >= self._end and self.may_return(around, speed):
            aside.back(progress, max(RAMP_M, speed * math.sqrt(6.0 * abs(aside.offset) / LATERAL_M_S2)))
            self.active = False

    def threats(self, around: Surroundings, speed: float, progress: float) -> set[int]:
        """Keys of the oncoming vehicles that the ego would meet if it went on passing."""
        if not (self.active and self._way.oncoming):
            return {one.key for one in around.driving() if one.oncoming}
        left = self._end - progress + 0.5 * RAMP_M
        strip = self._way.offset - self._half_width - 0.3, self._way.offset + self._half_width + 0.3
        top = max(PASSING_M_S - self._blocker.speed, 2.0)
        seconds = _seconds(max(left, 0.0), speed, top)
        return {
            one.key
            for one in around.driving()
            if one.oncoming
            and one.within(*strip)
            and one.s_high > self._half_length
            and one.s_low - self._comes(one, seconds) < left + self._half_length
            and one.s_high - one.speed * self._until_out(progress, speed) > self._half_length
        }

    def _until_out(self, progress: float, speed: float) -> float:
        """Until the ego is in the way of those who come, s."""
        start = self._end - 2 * self._half_length - (self._blocker.last - self._blocker.first) - TURN_OUT_M - progress
        return _seconds(start, speed, PASSING_M_S) if start > 0.0 else 0.0

    def may_return(self, around: Surroundings, speed: float) -> bool:
        """Whether nobody is in the ego's own lane beside it, or about to be."""
        return not any(self.in_the_way(one, 0.0, speed) for one in around.driving() if one.along > 0.0)

    def _ways(self, around: Surroundings, blocker: Blocker) -> list[Way]:
        """Ways round a blocker, the least disturbing first."""
        left = blocker.d_high + self._half_width + CLEARANCE_M
        right = blocker.d_low - self._half_width - CLEARANCE_M
        half = 0.5 * around.lane_width - self._half_width + 0.1
        inside = [Way(offset, False) for offset in (left, right) if abs(offset) <= half]
        lanes = around.lanes_beside(blocker.first - RAMP_M, blocker.last + RAMP_M)
        beside = [lane for lane in lanes if not lane.oncoming]
        ways = [Way(max(left, lane.d) if lane.d > 0.0 else min(right, lane.d), False) for lane in beside]
        edge = max((lane.d + 0.5 * lane.width for lane in lanes if lane.oncoming), default=half + self._half_width)
        if left + self._half_width <= edge + 0.3 and not any(lane.d > 0.0 for lane in beside):
            ways.append(Way(left, True))
        return inside + [way for way in ways if self._fits(way, lanes)]

    def _fits(self, way: Way, lanes: list[Lane]) -> bool:
        """Whether its side of the road is wide enough."""
        return any(abs(way.offset - lane.d) < 0.5 * lane.width + 0.3 for lane in lanes) or way.oncoming

    def has_room(self, around: Surroundings, way: Way, blocker: Blocker, speed: float, ramp: float) -> bool:
        """Whether nobody is, or will be, where the ego wants to go; the longer it has waited, the less it asks."""
        hurry = min(self._waited / HURRY_S, 1.0)
        for one in around.driving():
            if not one.within(way.offset - self._half_width - 0.3, way.offset + self._half_width + 0.3):
                continue
            if one.along < 0.0 and self._meets(one, blocker, speed, ramp, (1.0 - hurry) * MARGIN_M):
                return False
            if one.along >= 0.0 and self.in_the_way(one, way.offset, speed, hurry, blocker.last):
                return False
        return True

    def _meets(self, one: Neighbour, blocker: Blocker, speed: float, ramp: float, margin: float) -> bool:
        """Whether an oncoming vehicle is beside the blocker at the time when the ego is."""
        enter = max(blocker.first - self._half_length - 1.0 - 0.6 * ramp, 0.0)
        leave = blocker.last + self._half_length + 0.5 * RAMP_M
        top = max(PASSING_M_S - blocker.speed, 2.0)
        begins, ends = _seconds(enter, speed, top), _seconds(leave, speed, top)
        gone = one.s_high - one.speed * begins < enter + self._half_length - 1.0
        leave += blocker.speed * ends + self._half_length
        return not gone and one.s_low - self._comes(one, ends) < leave + 1.0 + margin

    def _comes(self, one: Neighbour, seconds: float) -> float:
        """How far an oncoming vehicle drives meanwhile, m; after a long wait the ego relies on its braking."""
        if not self._claims:
            return one.speed * seconds
        return min(one.speed * seconds, one.speed * REACTION_S + one.speed**2 / (2 * FOLLOWER_BRAKING))

    def in_the_way(
        self, one: Neighbour, offset: float, speed: float, hurry: float = 0.0, until: float = RAMP_M
    ) -> bool:
        """Whether somebody of the same direction is beside the ego, too slow ahead, or would have to brake hard."""
        if not one.within(offset - self._half_width - 0.3, offset + self._half_width + 0.3):
            return False
        if one.s_low > self._half_length + 1.0:
            return one.stands and one.s_low < until + RAMP_M
        closing = max(one.speed - speed - 2.0, 0.0)
        room = 2.0 + closing * (0.8 - 0.5 * hurry) + closing**2 / (2 * (FOLLOWER_BRAKING + 2.0 * hurry))
        return one.s_high > -self._half_length - room


def _seconds(distance: float, speed: float, top: float) -> float:
    """To drive a distance as when passing, up to a speed, s; the drive answers a little late."""
    top, twice = max(top, speed), 2 * 0.85 * PASSING_ACCELERATION
    ramp = (top**2 - speed**2) / twice
    if distance < ramp:
        return LAG_S + 2 * (math.sqrt(speed**2 + twice * distance) - speed) / twice
    return LAG_S + 2 * (top - speed) / twice + (distance - ramp) / top
