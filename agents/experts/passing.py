"""Passing: passes what blocks the ego's lane, through the lane beside it or a gap in the oncoming one."""

from __future__ import annotations

import math
from dataclasses import dataclass

from dohyo.agents.experts.blockers import Blocker, Patience, find_blocker
from dohyo.agents.experts.gaps import Stretch, leaves_room
from dohyo.agents.planning.sidestep import RAMP_M, Sidestep
from dohyo.agents.planning.surroundings import LaneBeside, Neighbour, Surroundings
from dohyo.sumo_networks.arrays import Float32Array

FREE = math.inf
PASSING_M_S = 10.0
CLEARANCE_M = 0.5
LEAST_CLEARANCE_M = 0.3
RUN_UP_M = 8.5
LONG_RUN_UP_M = 14.0
LONG_M = 12.0
CREEP_M = 0.4
CREEP_S = 30.0
MOST_CREEPS = 5.0
LEAST_RAMP_M = 6.0
HURRY_S = 40.0
MARGIN_M = 4.0
LEAST_MARGIN_M = 1.0
RELIES_AFTER_S = 8.0
RELIES_WHOLLY_S = 20.0
BRAKING = 4.5
HARDEST_BRAKING = 8.0
LATERAL_M_S2 = 3.0
BRISK_LATERAL_M_S2 = 4.5
TURNED_M = 0.15
INTO_HIS_LANE = 0.25
OUT_OF_HIS_LANE = 0.4
EARLY_M = 0.0
NOT_YET_OUT_M = 0.8
FOLLOWER_BRAKING = 3.0


@dataclass(frozen=True, slots=True)
class Way:
    """Way to pass a blocker.

    Attributes:
        offset: m to the left of the route.
        oncoming: Whether it uses the oncoming lane.
    """

    offset: float
    oncoming: bool


class Passing:
    """Decides when to leave the middle of the lane for a blocker, and when to return.

    Attributes:
        waits_at: Place at which to wait for a gap, m from the ego's front; infinite without need.
        active: Whether it is passing.
    """

    def __init__(self, half_length: float, half_width: float) -> None:
        self._half_length, self._half_width = half_length, half_width
        self._patience = Patience()
        self._waited, self._room = 0.0, math.inf
        self._out, self._end, self._top = 0.0, 0.0, PASSING_M_S
        self._way, self._blocker = Way(0.0, False), Blocker(0.0, 0.0, 0.0, 0.0, 0.0)
        self.active, self.waits_at = False, FREE

    def update(
        self,
        around: Surroundings,
        junctions: Float32Array,
        speed: float,
        limit: float,
        progress: float,
        aside: Sidestep,
    ) -> None:
        """Updates by one tick, and sets the sidestep."""
        self._patience.watch(around.neighbours)
        self.waits_at, self._top = FREE, min(PASSING_M_S, limit)
        reach = self._half_width + LEAST_CLEARANCE_M
        behind = -self._half_length if self.active else self._half_length
        blocker, decided = find_blocker(around, junctions, self._patience, reach, behind, self._half_length)
        if self.active:
            self._go_on(around, blocker, speed, progress, aside)
            return
        if blocker is None:
            self._forget_wait()
            return
        gap = blocker.first - self._half_length
        run_up = LONG_RUN_UP_M if blocker.last - blocker.first > LONG_M else RUN_UP_M
        if not decided:
            # Room is kept from actors that may be parked; one that was just driving is followed.
            self.waits_at = gap - run_up
            return
        if gap < 0.5:
            return
        for way in self._ways(around, blocker):
            ramp = self._ramp(way, gap, speed)
            if ramp is None:
                continue
            start = max(gap - 1.0 - ramp, 0.0)
            enter = 0.0 if abs(aside.at(progress)) > TURNED_M else start + INTO_HIS_LANE * ramp
            if self.has_room(around, way, blocker, speed, enter):
                aside.lead(way.offset, progress + start, ramp)
                self.active, self._way, self._blocker = True, way, blocker
                self._out = progress + enter
                self._end = progress + self._past(blocker)
                return
        if blocker.speed == 0.0:
            self.waits_at = self._wait(gap, run_up, speed)

    def _wait(self, gap: float, run_up: float, speed: float) -> float:
        """Stopping place, m from the front: with room to turn out, and moved forward from time to time.

        This shows the ego's intention to oncoming traffic.
        """
        self._waited += 0.1
        if speed < 0.1 and math.isinf(self._room):
            self._room = gap
        return gap - min(run_up, self._room) + CREEP_M * min(self._waited // CREEP_S, MOST_CREEPS)

    def _forget_wait(self) -> None:
        self._waited, self._room = 0.0, math.inf

    def _past(self, blocker: Blocker) -> float:
        """Place to turn back, m from the centre: at once with oncoming traffic, since the ramp takes effect later."""
        return blocker.last + (EARLY_M if self._way.oncoming else self._half_length)

    @staticmethod
    def _ramp(way: Way, gap: float, speed: float) -> float | None:
        """Length of the turn out, m; None where there is too little room for it at this speed."""
        gentle = speed * math.sqrt(6.0 * abs(way.offset) / LATERAL_M_S2)
        return None if 0.9 * gentle > gap else min(max(gentle, LEAST_RAMP_M), max(gap - 1.0, LEAST_RAMP_M))

    def _way_back(self, way: Way, speed: float) -> float:
        """Length of the turn back, m; shorter with oncoming traffic."""
        least, lateral = (LEAST_RAMP_M, BRISK_LATERAL_M_S2) if way.oncoming else (RAMP_M, LATERAL_M_S2)
        return max(least, speed * math.sqrt(6.0 * abs(way.offset) / lateral))

    def _go_on(
        self, around: Surroundings, blocker: Blocker | None, speed: float, progress: float, aside: Sidestep
    ) -> None:
        if blocker is not None and blocker.first < self._end - progress + 2 * RAMP_M:
            self._end = progress + self._past(blocker)
            self._blocker = blocker
        not_yet_out = abs(aside.at(progress)) < NOT_YET_OUT_M < abs(aside.offset)
        if not_yet_out and self._hindered(around, speed, progress):
            aside.back(progress, LEAST_RAMP_M)
            self.active = False
        elif progress >= self._end and self.may_return(around, speed):
            aside.back(progress, self._way_back(self._way, speed))
            self.active = False
            self._forget_wait()

    def _hindered(self, around: Surroundings, speed: float, progress: float) -> bool:
        """Whether somebody now comes on the way round who did not when the ego set out, such as after a lane change."""
        if self._way.oncoming:
            return bool(self.threats(around, speed, progress))
        hurry, ahead = self._impatience, self._half_length + 1.0
        followers = (one for one in around.driving() if one.along > 0.0 and one.s_low <= ahead)
        others = (one for one in followers if not one.within(-self._half_width, self._half_width))
        return any(self.in_the_way(one, self._way.offset, speed, hurry) for one in others)

    @property
    def _impatience(self) -> float:
        """From 0 to 1 with the waiting time; requirements fall with it."""
        return min(self._waited / HURRY_S, 1.0)

    def threats(self, around: Surroundings, speed: float, progress: float) -> set[int]:
        """Keys of oncoming vehicles that the ego would meet if it continued to pass."""
        if not (self.active and self._way.oncoming):
            return {one.key for one in around.driving() if one.oncoming}
        return {key for key, leaves in self._met(around, speed, progress).items() if not leaves}

    def making_room(self, around: Surroundings, speed: float, progress: float) -> set[int]:
        """Keys of oncoming vehicles on the way round the blocker that, as judged, leave it in time or brake."""
        if not (self.active and self._way.oncoming):
            return set()
        return {key for key, leaves in self._met(around, speed, progress).items() if leaves}

    def _met(self, around: Surroundings, speed: float, progress: float) -> dict[int, bool]:
        """Oncoming vehicles on the way round the blocker, and whether each leaves room."""
        stretch = self._stretch(self._way, self._out - progress, self._end - progress, speed)
        braking = HARDEST_BRAKING if stretch.enter <= 0.0 else self._reliance()
        return {
            one.key: self._leaves_room(one, stretch, speed, braking, 0.0, self._blocker.speed)
            for one in around.driving()
            if one.opposes and one.s_high > self._half_length and self._in_strip(one, self._way)
        }

    def _stretch(self, way: Way, enter: float, end: float, speed: float) -> Stretch:
        fastest = min(math.sqrt(speed**2 + 5.0 * max(end, 0.0)), max(self._top, speed))
        return Stretch(enter, end + OUT_OF_HIS_LANE * self._way_back(way, fastest), self._top)

    def _in_strip(self, one: Neighbour, way: Way) -> bool:
        return one.within(way.offset - self._half_width - 0.3, way.offset + self._half_width + 0.3)

    def _reliance(self) -> float:
        """Braking expected of others, m/s^2: none at first, more with the waiting time."""
        return BRAKING * min(max(self._waited - RELIES_AFTER_S, 0.0) / (RELIES_WHOLLY_S - RELIES_AFTER_S), 1.0)

    def _leaves_room(
        self, one: Neighbour, stretch: Stretch, speed: float, braking: float, margin: float, crawl: float
    ) -> bool:
        enter, leave, top = stretch.enter, stretch.leave, max(stretch.top, crawl + 2.0)
        return bool(
            leaves_room(
                one.s_low, one.s_high, one.speed, enter, leave, top, speed, self._half_length, braking, margin, crawl
            )
        )

    def may_return(self, around: Surroundings, speed: float) -> bool:
        """Whether the ego's own lane beside it is free, and stays free."""
        past = -self._half_length if not self._way.oncoming else EARLY_M
        beside = (one for one in around.driving() if one.along > 0.0 and not (one.stands and one.s_high <= past))
        return not any(self.in_the_way(one, 0.0, speed) for one in beside)

    def _ways(self, around: Surroundings, blocker: Blocker) -> list[Way]:
        """Ways to pass a blocker, the least disturbing first."""
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

    def _fits(self, way: Way, lanes: list[LaneBeside]) -> bool:
        """Whether its side of the road is wide enough."""
        return any(abs(way.offset - lane.d) < 0.5 * lane.width + 0.3 for lane in lanes) or way.oncoming

    def has_room(self, around: Surroundings, way: Way, blocker: Blocker, speed: float, enter: float) -> bool:
        """Whether a way is free and stays free; requirements fall with the waiting time.

        Args:
            around: Actors and lanes.
            way: The way to judge.
            blocker: The blocker to pass.
            speed: Of the ego, m/s.
            enter: Where the ego begins to be in the way of oncoming traffic, m from its centre.
        """
        hurry = self._impatience
        stretch = self._stretch(way, enter, blocker.last + EARLY_M, speed)
        margin = LEAST_MARGIN_M + (1.0 - hurry) * MARGIN_M
        for one in around.driving():
            if not self._in_strip(one, way):
                continue
            if one.along < 0.0:
                if not self._leaves_room(one, stretch, speed, self._reliance(), margin, blocker.speed):
                    return False
            elif self.in_the_way(one, way.offset, speed, hurry, blocker.last):
                return False
        return True

    def in_the_way(
        self, one: Neighbour, offset: float, speed: float, hurry: float = 0.0, until: float = RAMP_M
    ) -> bool:
        """Whether traffic in the same direction is beside the ego, stands ahead, or would have to brake hard."""
        if not one.within(offset - self._half_width - 0.3, offset + self._half_width + 0.3):
            return False
        if one.s_low > self._half_length + 1.0:
            return one.stands and one.s_low < until + RAMP_M
        closing = max(one.speed - speed - 2.0, 0.0)
        room = 2.0 + closing * (0.8 - 0.5 * hurry) + closing**2 / (2 * (FOLLOWER_BRAKING + 2.0 * hurry))
        return one.s_high > -self._half_length - room
