"""Facts: an observation as atoms for the rules.

All numbers are whole: distances in dm, speeds in dm/s, accelerations in dm/s^2, times in tenths of a second. What each
fact means stands beside its declaration in `rules/vocabulary.lp`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from dohyo.agents.planning.crossing import crossers
from dohyo.agents.planning.sidestep import Sidestep
from dohyo.agents.planning.stop_signs import NextStop
from dohyo.agents.planning.surroundings import LaneBeside, Neighbour, Surroundings
from dohyo.agents.rules.solver import Fact, fact
from dohyo.agents.safety.rss_monitor import Danger
from dohyo.evaluation.agent import Observation
from dohyo.sumo_networks.arrays import Float32Array
from dohyo.sumo_networks.ego.dynamics import VehicleParameters
from dohyo.sumo_networks.rules.right_of_way import RightOfWay
from dohyo.sumo_networks.sensors.path import BEHIND, POINTS
from dohyo.sumo_networks.units import TICK_S
from dohyo.sumo_networks.world import ActorKind, LightState

SENSORS = ("speedometer", "route", "objects", "junctions_ahead", "conflicts", "navigation", "path", "lanes")
"""Sensors that facts are made of."""
FAR_M = 1000.0
NEAREST_AHEAD, NEAREST_CROSSING, NEAREST_IN_LANE = 4, 8, 3
SIGHT_M = float(POINTS - BEHIND - 1)
STANDS_M_S, DROVE_M_S, WAITS_M_S = 0.3, 1.0, 0.6
ASKEW = 0.997
CORRIDOR_MARGIN_M = 0.3
STRIP_MARGIN_M = 0.3
CUT_IN_S, CUT_IN_SIDEWAYS_M_S = 1.5, 0.25
RACING_M_S, RACED_S, RACING_AHEAD_M = 2.5, 3.0, 90.0
KERB_M, KERB_AHEAD_M = 1.5, 30.0
PASSING_M_S, PASSING_ACCELERATION = 10.0, 3.0
CROSSING_M_S, CROSSING_ACCELERATION = 8.0, 1.5
LINE_GAP_M = 1.0
KIND = {kind: kind.name.lower() for kind in ActorKind}
SIGNAL = {int(LightState.RED): "red", int(LightState.YELLOW): "yellow", int(LightState.GREEN): "green"}
SIGN: dict[int, str] = {RightOfWay.YIELD: "yield", RightOfWay.STOP: "stop"}
SIDES = ("left", "right")
PEDESTRIAN = ActorKind.PEDESTRIAN


def tenths(value: float) -> int:
    """In tenths of its unit, rounded down, within what clingo can multiply."""
    return math.floor(min(max(value, -FAR_M), FAR_M) * 10.0 + 1e-6)


@dataclass(frozen=True, slots=True)
class Moment:
    """One observation in the form that rules and control use.

    Attributes:
        facts: For the rules.
        ahead: Gap [m] and speed along the path [m/s] of all actors in, or about to enter, the ego's way, by key.
        lanes: Middle of the lane on each side, m to the left of the route.
        squeeze: Offset that lets oncoming traffic in the ego's lane pass, m to the left.
    """

    facts: tuple[Fact, ...]
    ahead: dict[int, tuple[float, float]]
    lanes: dict[str, float]
    squeeze: float


@dataclass(slots=True)
class Memory:
    """Memory of earlier observations.

    Attributes:
        standing: Time for which the ego has stood or crept, s.
        refused: Time for which it has waited for crossing traffic, s.
        stop: The next stop sign, and whether it has stood there.
        stood: Standing time of each actor, s.
        driven: Actors that have been seen driving.
        raced: Remaining time of mistrust of each actor that was seen racing, s.
    """

    standing: float = 0.0
    refused: float = 0.0
    stop: NextStop = field(default_factory=NextStop)
    stood: dict[int, float] = field(default_factory=dict)
    driven: set[int] = field(default_factory=set)
    raced: dict[int, float] = field(default_factory=dict)

    def watch(self, observation: Observation, neighbours: Sequence[Neighbour]) -> None:
        """Updates by one tick."""
        speed, junctions = float(observation["speedometer"][0]), observation["junctions_ahead"]
        # Creeping up to a line counts as waiting; driving reduces the waiting time.
        self.standing = self.standing + TICK_S if speed < WAITS_M_S else max(self.standing - 5 * TICK_S, 0.0)
        self.stood = {one.key: self.stood.get(one.key, 0.0) + TICK_S for one in neighbours if one.stands}
        self.driven |= {one.key for one in neighbours if one.speed > DROVE_M_S}
        racing = float(observation["path"][BEHIND, 4]) + RACING_M_S
        kept = {key: left - TICK_S for key, left in self.raced.items() if left > TICK_S}
        self.raced = kept | {one.key: RACED_S for one in neighbours if one.speed > racing}
        self.stop.update(speed, junctions)

    def wait(self, speed: float, waiting: bool) -> None:
        """Updates the waiting time of the ego."""
        kept = waiting and speed < WAITS_M_S
        self.refused = self.refused + TICK_S if kept else max(self.refused - 5 * TICK_S, 0.0)


class FactsBuilder:
    """Makes the facts of successive observations."""

    def __init__(self) -> None:
        vehicle = VehicleParameters()
        self._half_length, self._half_width = vehicle.length / 2, vehicle.width / 2

    def moment(
        self,
        observation: Observation,
        around: Surroundings,
        memory: Memory,
        aside: Sidestep,
        dangers: Sequence[Danger],
        advised: float,
    ) -> Moment:
        """Facts of the present observation.

        Args:
            observation: With `SENSORS`.
            around: Made of the observation.
            memory: Already updated.
            aside: Where the ego's path leaves the route's.
            dangers: Found by RSS.
            advised: Speed that limits and curves allow, m/s.
        """
        speed, progress = float(observation["speedometer"][0]), float(observation["navigation"][2])
        out = [fact("speed", tenths(speed)), fact("advised", tenths(advised))]
        out += [fact("standing", tenths(memory.standing)), fact("refused", tenths(memory.refused))]
        out += self._junctions(observation["junctions_ahead"], memory)
        ahead = self._ahead(around.neighbours, speed, aside, progress)
        for one, gap, pace in ahead:
            out += self._blocker(one, gap, pace, speed, memory)
        entering = {} if aside.aside(progress) else self._entering(around, speed)
        out += [fact("enters", key, tenths(gap), tenths(pace)) for key, (gap, pace) in entering.items()]
        out += self._crossings(observation, around, speed)
        out += [fact("races", key) for key in _coming(around) if key in memory.raced]
        out += self._on_foot(around, aside, progress)
        room = 0.5 * around.lane_width - self._half_width + 0.05
        out_of_lane = max(abs(aside.offset), abs(aside.at(progress))) > room
        lanes = {} if out_of_lane else self._lanes(around, ahead)
        for side, lane in lanes.items():
            out += [fact("lane", side, "against" if lane.oncoming else "same")]
            out += self._in_lane(around, side, lane.d)
        if out_of_lane:
            out += [fact("aside", "left" if aside.at(progress) + aside.offset > 0.0 else "right")]
            out += self._in_lane(around, "own", 0.0)
        out.append(fact("sight", tenths(_sight(observation["objects"]))))
        out += [fact("critical", danger.key, tenths(danger.braking)) for danger in dangers if danger.braking > 0.0]
        squeeze = self._squeeze(around, speed)
        if squeeze < 0.0:
            out.append(fact("squeezed"))
        numbers = {one.key: (gap, pace) for one, gap, pace in ahead} | entering
        return Moment(tuple(out), numbers, {side: lane.d for side, lane in lanes.items()}, squeeze)

    def _junctions(self, junctions: Float32Array, memory: Memory) -> Iterator[Fact]:
        for number, (entry, leave, signal, sign) in enumerate(junctions.tolist(), start=1):
            if entry >= FAR_M:
                break
            yield fact("junction", number, tenths(entry), tenths(leave))
            if int(signal) in SIGNAL:
                yield fact("signal", number, SIGNAL[int(signal)])
            if int(sign) in SIGN:
                yield fact("sign", number, SIGN[int(sign)])
        if memory.stop.stood:
            yield fact("stood_at", memory.stop.row + 1)

    def _ahead(
        self, neighbours: Sequence[Neighbour], speed: float, aside: Sidestep, progress: float
    ) -> list[tuple[Neighbour, float, float]]:
        """Actors in the strip that the ego will need, with gap [m] and speed along the path [m/s]."""
        reach = self._half_width + CORRIDOR_MARGIN_M
        found = []
        for one in neighbours:
            gap = one.s_low - self._half_length
            if one.s_high < self._half_length or gap > SIGHT_M:
                continue
            offset = aside.at(progress + max(one.s_low, 0.0))
            # Who stands beside it already is for the steering; for who still moves there a standing ego waits.
            waits = speed < STANDS_M_S <= one.speed
            if one.within(offset - reach, offset + reach) and (gap > -1.0 or waits):
                found.append((one, max(gap, 0.0), one.speed * one.along))
        return sorted(found, key=lambda row: row[1])[:NEAREST_AHEAD]

    def _blocker(self, one: Neighbour, gap: float, pace: float, speed: float, memory: Memory) -> Iterator[Fact]:
        yield fact("ahead", one.key, KIND[ActorKind(one.kind)], tenths(gap), tenths(pace))
        if one.speed >= STANDS_M_S and one.kind != ActorKind.BICYCLE:
            return
        last = one.s_high - self._half_length
        yield fact("extent", one.key, tenths(last))
        room = last + 2 * self._half_length + 6.0
        yield fact("takes", one.key, tenths(_passing_seconds(room, speed, max(pace, 0.0))))
        if one.stands:
            yield fact("stood", one.key, tenths(memory.stood.get(one.key, 0.0)))
        if one.key in memory.driven:
            yield fact("driven", one.key)
        if abs(one.along) < ASKEW:
            yield fact("askew", one.key)

    def _entering(self, around: Surroundings, speed: float) -> dict[int, tuple[float, float]]:
        """Actors beside the ego's strip, ahead of its middle, that move into it."""
        reach, out = self._half_width + CORRIDOR_MARGIN_M, {}
        for one in around.driving():
            sideways = one.speed * one.across
            if one.along < 0.5 or one.s_high < self._half_length or one.s_low > 40.0 or one.within(-reach, reach):
                continue
            towards = -sideways if one.d_low > 0.0 else sideways
            distance = one.d_low - reach if one.d_low > 0.0 else -reach - one.d_high
            if towards > CUT_IN_SIDEWAYS_M_S and distance < towards * CUT_IN_S:
                out[one.key] = (max(one.s_low - self._half_length, 0.0), one.speed * one.along)
        return out

    def _crossings(self, observation: Observation, around: Surroundings, speed: float) -> Iterator[Fact]:
        """Times at which the ego and another reach the meeting of their paths."""
        unforeseen = crossers(around, self._half_length, self._half_width)
        headings = {one.key: one.across for one in around.neighbours}
        known: set[int] = set()
        for row in np.concatenate([unforeseen, observation["conflicts"]]).tolist():
            enter, leave, other_enter, other_leave, other_speed, priority, kind, key = row
            if kind < 0 or len(known) == NEAREST_CROSSING:
                break
            key = int(key)
            if key in known:
                continue
            known.add(key)
            kind = PEDESTRIAN if kind == PEDESTRIAN else ActorKind(int(kind))
            arrive = travel_time(enter, speed, CROSSING_ACCELERATION, CROSSING_M_S)
            clear = min(leave, enter + 12.0 + 2 * self._half_length) + LINE_GAP_M
            clear = travel_time(clear, speed, CROSSING_ACCELERATION, CROSSING_M_S)
            yield fact("meets", key, KIND[kind], tenths(enter))
            yield fact("comes", key, tenths(other_enter), tenths(other_leave), tenths(other_speed))
            if leave >= FAR_M:
                yield fact("merges", key)
                clear = arrive + 0.5
            yield fact("ego_at", key, tenths(arrive), tenths(clear))
            first, last = _earliest(other_enter, other_speed, kind), other_leave / max(other_speed, 0.3)
            yield fact("other_at", key, tenths(first), tenths(max(last, 0.0)))
            if priority != 0.0:
                yield fact("right_of_way", key, holds=priority > 0.0)
            # An actor from the right drives to the left.
            if headings.get(key, 0.0) > 0.5:
                yield fact("from_right", key)

    def _on_foot(self, around: Surroundings, aside: Sidestep, progress: float) -> Iterator[Fact]:
        """Pedestrians at the edge of the ego's strip."""
        reach = self._half_width + CORRIDOR_MARGIN_M
        for one in around.neighbours:
            gap = one.s_low - self._half_length
            offset = aside.at(progress)
            edge = max(one.d_low - offset - reach, offset - reach - one.d_high)
            if one.kind != PEDESTRIAN or not 0.0 < gap < KERB_AHEAD_M or not 0.0 < edge < KERB_M:
                continue
            yield fact("kerb", one.key, tenths(gap))
            towards = -one.across if one.d_low > offset else one.across
            if one.speed > STANDS_M_S and towards < 0.3:
                yield fact("crosses", one.key, holds=False)

    def _lanes(self, around: Surroundings, ahead: Sequence[tuple[Neighbour, float, float]]) -> dict[str, LaneBeside]:
        """Lanes beside a possible blocker: same direction first, then opposite."""
        slow = [one for one, _, pace in ahead if one.speed < STANDS_M_S or one.kind == ActorKind.BICYCLE]
        if not slow:
            return {}
        lanes = around.lanes_beside(slow[0].s_low - 12.0, max(one.s_high for one in slow) + 12.0)
        out: dict[str, LaneBeside] = {}
        for lane in sorted(lanes, key=lambda lane: lane.oncoming):
            out.setdefault(SIDES[0] if lane.d > 0.0 else SIDES[1], lane)
        return out

    def _in_lane(self, around: Surroundings, side: str, d: float) -> Iterator[Fact]:
        strip = d - self._half_width - STRIP_MARGIN_M, d + self._half_width + STRIP_MARGIN_M
        inside = [one for one in around.driving() if one.within(*strip)]
        # The nearest of each side, so that a queue that has been passed hides nobody who comes.
        ahead = sorted((one for one in inside if one.s_low + one.s_high >= 0.0), key=lambda one: one.s_low)
        behind = sorted((one for one in inside if one.s_low + one.s_high < 0.0), key=lambda one: -one.s_high)
        for one in (*ahead[:NEAREST_IN_LANE], *behind[:NEAREST_IN_LANE]):
            low, high = one.s_low - self._half_length, one.s_high + self._half_length
            yield fact("in_lane", side, one.key, tenths(low), tenths(high), tenths(one.speed * one.along))

    def _squeeze(self, around: Surroundings, speed: float) -> float:
        """Offset from the middle of the lane that gives room to oncoming traffic, m."""
        most = max(0.5 * around.lane_width - self._half_width - 0.1, 0.0)
        wanted = 0.0
        for one in around.driving():
            near = one.oncoming and -self._half_width < one.s_high and one.s_low < (speed + one.speed) * 6.0
            if near and one.within(-self._half_width, self._half_width + 0.25):
                wanted = max(wanted, self._half_width + 0.5 - one.d_low)
        return -min(wanted, most)


def travel_time(distance: float, speed: float, acceleration: float, top: float) -> float:
    """Time to cover a distance [m], accelerating [m/s^2] up to a top speed [m/s], s; 0 where it is behind."""
    top, distance = max(top, speed), max(distance, 0.0)
    ramp = (top**2 - speed**2) / (2 * acceleration)
    if distance <= ramp:
        return (math.sqrt(speed**2 + 2 * acceleration * distance) - speed) / acceleration
    return (top - speed) / acceleration + (distance - ramp) / top


def _passing_seconds(distance: float, speed: float, pace: float) -> float:
    """Time until the ego is past an actor whose front is so far ahead [m] and that moves at a speed [m/s], s."""
    top = max(PASSING_M_S - pace, 2.0)
    return 0.5 + travel_time(distance, max(speed - pace, 0.0), 0.85 * PASSING_ACCELERATION, top)


def _earliest(distance: float, speed: float, kind: ActorKind) -> float:
    """Earliest arrival of another, s: vehicles may accelerate, pedestrians keep their speed."""
    if distance <= 0.0:
        return 0.0
    if kind == PEDESTRIAN:
        return distance / max(speed, 0.1)
    return travel_time(distance, speed, CROSSING_ACCELERATION, CROSSING_M_S)


def _coming(around: Surroundings) -> list[int]:
    """Actors that are near, not behind, and on a way other than the ego's."""
    near = (one for one in around.driving() if one.s_high > 0.0 and one.s_low < RACING_AHEAD_M)
    return [one.key for one in near if one.along < 0.5]


def _sight(objects: Float32Array) -> float:
    """Range in which all actors are known, m: a full table ends at its last row."""
    last = objects[-1]
    return SIGHT_M if last[0] < 0 else min(float(math.hypot(last[1], last[2])), SIGHT_M)
