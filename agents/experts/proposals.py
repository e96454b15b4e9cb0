"""PDM's proposals: fifteen ways to follow the route, simulated and scored together in numba."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from dohyo.agents.planning.motion import (
    DT,
    Body,
    Idm,
    boxes_meet,
    idm_acceleration,
    limited_steering,
    project,
    pursuit,
    vehicle_step,
)
from dohyo.agents.planning.situation import (
    CLASS_OBJECT,
    CLASS_PEDESTRIAN,
    COARSE_S,
    JUNCTION_BIT,
    NO_LINE,
    ROAD_BIT,
    ROUTE_BIT,
    Situation,
    at_row,
    box_on_grid,
    leader,
    on_grid,
)
from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.geometry import wrap

OFFSETS_M = (0.0, -1.0, 1.0)
FACTORS = (0.2, 0.4, 0.6, 0.8, 1.0)
PROPOSALS = len(OFFSETS_M) * len(FACTORS)
STEPS = 40
X, Y, HEADING, SPEED, ACCELERATION, STEERING, S, CENTRE_X, CENTRE_Y, WHEEL, DEMAND = range(11)
STATE = 11
"""Rear axle x, y [m], heading [rad], speed [m/s], acceleration [m/s^2], wheel angle [rad], arc length [m], box centre
x, y [m], demanded wheel angle [rad] and acceleration [m/s^2]."""
NC, DAC, DDC, EP, TTC, COMFORT, TOTAL, MET_AT, OFF_AT, SHORT_AT = range(10)
SCORES = 10
"""Multipliers NC, DAC, DDC; shares EP, TTC, C; the score; times of the first collision, of leaving the road, and
from which on the time to collision is short, s (infinite: never)."""
STOPPING_S, HALTING = 0.8, 0.5
"""Braking of the last metres: speed over that time, at least so much, m/s^2, without a jolt (ours)."""
YIELD_S, PERSON_GAP_M = 4.0, 1.0
"""Time and distance within which the ego waits for pedestrians about to step into its way (ours)."""
STANDING = 0.05
BEHIND_COS = -math.sqrt(3.0) / 2.0
TTC_AHEAD_S = (0.0, 0.3, 0.6, 0.9)
AHEAD_COS = math.sqrt(3.0) / 2.0
JERK_STEPS = 7


@njit(cache=True, error_model="numpy")
def roll_out(
    road: Situation, car: Body, idm: Idm, line_gap: float, margin: float, start: FloatArray, states: FloatArray,
    careful: bool,
) -> None:  # fmt: skip
    """Simulates every proposal.

    Args:
        road: The situation.
        car: The vehicle.
        idm: Of all proposals.
        line_gap: Between the front and a closed line, m.
        margin: Width added on each side of the ego; an actor ahead within it is a leader, m.
        start: (11,) present state of the ego; every proposal begins with a copy.
        states: (15, 41, 11) where the states are written.
        careful: Whether to stop gently and to wait for people about to cross (ours).
    """
    crossing = _crossing(road, car, margin, start[SPEED], idm.hardest) if careful else NO_LINE
    for number in range(states.shape[0]):
        offset, factor = OFFSETS_M[number // len(FACTORS)], FACTORS[number % len(FACTORS)]
        states[number, 0] = start
        gap, leading = math.inf, 0.0
        for k in range(states.shape[1] - 1):
            now, then = states[number, k], states[number, k + 1]
            speed, s = now[SPEED], now[S]
            if k % 2 == 0:  # the leader is looked up every second step
                gap, leading = leader(road, 0.5 * car.length, 0.5 * car.width + margin, s, k * DT, offset)
            else:
                gap += (leading - speed) * DT
            ahead, pace = gap, leading
            if min(road.line, crossing) < NO_LINE:
                line = min(road.line, crossing) - s - 0.5 * car.length - line_gap + idm.gap
                if line > -2.0 and line < ahead:
                    ahead, pace = line, 0.0
            allowed = road.allowed[at_row(road, s)]
            demand = idm_acceleration(idm, speed, factor * allowed, ahead, pace)
            if speed > allowed:  # a curve is near: slow down whatever IDM's exponent says
                demand = min(demand, max(allowed - speed, -idm.hardest))
            if careful:
                demand = max(demand, -max(speed / STOPPING_S, HALTING))
            x, y, heading = now[X], now[Y], now[HEADING]
            wheel = pursuit(car, road.path, road.first_s, road.spacing, x, y, heading, speed, s, offset)
            wheel = limited_steering(car, speed, wheel)
            now[WHEEL], now[DEMAND] = wheel, demand
            then[X], then[Y], then[HEADING], then[SPEED], then[ACCELERATION], then[STEERING] = vehicle_step(
                car, x, y, heading, speed, now[ACCELERATION], now[STEERING], demand, wheel
            )
            cos, sin = math.cos(then[HEADING]), math.sin(then[HEADING])
            then[CENTRE_X], then[CENTRE_Y] = then[X] + car.axle * cos, then[Y] + car.axle * sin
            near = s + 0.1 * speed
            then[S], _, _ = project(road.path, road.first_s, road.spacing, then[CENTRE_X], then[CENTRE_Y], near, 4.0)


@njit(cache=True, error_model="numpy")
def _crossing(road: Situation, car: Body, margin: float, speed: float, braking: float) -> float:
    """Arc length [m] before which to wait for a pedestrian who is about to step into the ego's way."""
    nearest, half = NO_LINE, 0.5 * car.width + margin
    enough = 0.5 * car.length + speed * speed / (2.0 * braking)
    for n in range(road.along.shape[1]):
        if road.kind[n] != CLASS_PEDESTRIAN:
            continue
        was_in = True
        for k in range(round(YIELD_S / COARSE_S) + 1):
            inside = abs(road.along[k, n, 1]) <= half + road.along[k, n, 2]
            if inside and not was_in:
                before = road.along[k, n, 0] - road.along[k, n, 3] - PERSON_GAP_M
                if before > enough:
                    nearest = min(nearest, before)
                break
            was_in = inside
    return nearest


@njit(cache=True, error_model="numpy")
def score(road: Situation, car: Body, states: FloatArray, scores: FloatArray, leeway: float) -> None:
    """Scores every proposal: NC x DAC x DDC x (5 EP + 5 TTC + 2 C) / 12, EP relative to the best.

    Args:
        road: The situation.
        car: The vehicle.
        states: (15, 41, 11) from `roll_out`.
        scores: (15, 10) where the terms are written.
        leeway: Time by which an actor may be earlier or later in a junction than forecast, s.
    """
    farthest = 0.0
    for number in range(states.shape[0]):
        _judge(road, car, states[number], scores[number], leeway)
        terms = scores[number]
        terms[EP] = max(states[number, states.shape[1] - 1, S] - states[number, 0, S], 0.0)
        if terms[NC] * terms[DAC] * terms[DDC] > 0.0:
            farthest = max(farthest, terms[EP])
    for number in range(states.shape[0]):
        terms = scores[number]
        # If no proposal makes progress, standing is no fault.
        terms[EP] = min(terms[EP] / farthest, 1.0) if farthest > 0.5 else 1.0
        weighted = (5.0 * terms[EP] + 5.0 * terms[TTC] + 2.0 * terms[COMFORT]) / 12.0
        terms[TOTAL] = terms[NC] * terms[DAC] * terms[DDC] * weighted


@njit(cache=True, error_model="numpy")
def _judge(road: Situation, car: Body, states: FloatArray, terms: FloatArray, leeway: float) -> None:
    terms[NC] = terms[DAC] = terms[DDC] = terms[TTC] = 1.0
    terms[MET_AT] = terms[OFF_AT] = terms[SHORT_AT] = math.inf
    half_length, half_width = 0.5 * car.length, 0.5 * car.width
    against, window = 0.0, np.zeros(10)
    was_off = True
    for k in range(states.shape[0]):
        x, y, heading, speed = states[k, CENTRE_X], states[k, CENTRE_Y], states[k, HEADING], states[k, SPEED]
        cos, sin = math.cos(heading), math.sin(heading)
        inside = (on_grid(road.grid, x, y) & JUNCTION_BIT) != 0
        early = leeway if inside else 0.0
        hit = _met(road, car, x, y, cos, sin, x, y, speed, k, BEHIND_COS, early)
        if hit >= 0 and terms[MET_AT] == math.inf:
            terms[NC] = 0.5 if road.kind[hit] == CLASS_OBJECT else 0.0
            terms[MET_AT] = k * DT
        on_road = box_on_grid(road.grid, x, y, cos, sin, half_length, half_width) & ROAD_BIT
        if not on_road and not was_off:
            terms[DAC] = 0.0
            terms[OFF_AT] = min(terms[OFF_AT], k * DT)
        was_off = was_off and not on_road
        step = speed * DT if not on_grid(road.grid, x, y) & ROUTE_BIT and on_grid(road.grid, x, y) & ROAD_BIT else 0.0
        against += step - window[k % 10]
        window[k % 10] = step
        if against > 6.0:
            terms[DDC] = 0.0
        elif against > 2.0:
            terms[DDC] = min(terms[DDC], 0.5)
        if terms[TTC] > 0.0 and speed > STANDING:
            seen, axle_x, axle_y = BEHIND_COS if inside else AHEAD_COS, states[k, X], states[k, Y]
            for ahead in TTC_AHEAD_S:
                moved, then = speed * ahead, min(k + round(ahead / DT), road.boxes.shape[0] - 1)
                there_x, there_y = x + moved * cos, y + moved * sin
                if _met(road, car, there_x, there_y, cos, sin, axle_x, axle_y, speed, then, seen, early) >= 0:
                    terms[TTC], terms[SHORT_AT] = 0.0, k * DT
                    break
    terms[COMFORT] = 1.0 if _comfortable(states) else 0.0


@njit(cache=True, error_model="numpy")
def _met(
    road: Situation, car: Body, x: float, y: float, cos: float, sin: float, from_x: float, from_y: float, speed: float,
    k: int, least_cos: float, leeway: float,
) -> int:  # fmt: skip
    """An actor that the ego's box touches at a step, if the ego moves; -1 for none.

    The actor's centre must be within an angle of the heading, seen from a point: for collisions the centre of the box,
    as the criteria have it; for the time to collision the rear axle of where the ego is, not of where it would be, as
    in PDM's scorer and nuPlan's.
    """
    if speed <= STANDING:
        return -1
    half_length, half_width = 0.5 * car.length, 0.5 * car.width
    reach = math.hypot(half_length, half_width)
    for n in range(road.boxes.shape[1]):
        ox, oy = road.boxes[k, n, 0], road.boxes[k, n, 1]
        dx, dy, early = ox - x, oy - y, leeway * road.speed[n]
        square, far = dx * dx + dy * dy, reach + road.reach[n] + early
        if square > far * far:
            continue
        seen_x, seen_y = ox - from_x, oy - from_y
        if seen_x * cos + seen_y * sin < least_cos * math.sqrt(seen_x * seen_x + seen_y * seen_y):
            continue
        oc, os, ol, ow = road.boxes[k, n, 2], road.boxes[k, n, 3], road.boxes[k, n, 4], road.boxes[k, n, 5]
        if boxes_meet(x, y, cos, sin, half_length, half_width, ox, oy, oc, os, ol + early, ow):
            return n
    return -1


@njit(cache=True, error_model="numpy")
def _comfortable(states: FloatArray) -> bool:
    """Whether rates over 0.1 s and jerks over 1.4 s, in place of nuPlan's filters, stay within its bounds.

    Its filter of the yaw acceleration is kept: the second derivative of a cubic fitted to the headings of 1.5 s.
    """
    last = states.shape[0] - 1
    for k in range(last):
        rate = wrap(states[k + 1, HEADING] - states[k, HEADING]) / DT
        acceleration, lateral = states[k + 1, ACCELERATION], states[k + 1, SPEED] * rate
        if acceleration < -4.05 or acceleration > 2.40 or abs(lateral) > 4.89 or abs(rate) > 0.95:
            return False
    for k in range(JERK_STEPS, last - JERK_STEPS):
        jerk = (states[k + JERK_STEPS, ACCELERATION] - states[k - JERK_STEPS, ACCELERATION]) / (2 * JERK_STEPS * DT)
        turning = 0.0
        for i in range(-JERK_STEPS, JERK_STEPS + 1):
            turned = wrap(states[k + i, HEADING] - states[k, HEADING])
            turning += (3 * i * i - 56) / 6188.0 * turned / DT**2  # Savitzky and Golay 1964, 15 points
        if abs(jerk) > 4.13 or abs(turning) > 1.93:
            return False
    return True
