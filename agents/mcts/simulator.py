"""Inner simulator: the result of one held action, and its reward. Numba, no allocation."""

from __future__ import annotations

import math

from dohyo.agents.mcts.config import ACTIONS, DT, MIDDLE, Rules
from dohyo.agents.mcts.kernels import kernel, uncounted
from dohyo.agents.planning import motion
from dohyo.agents.planning import situation as around
from dohyo.agents.planning.motion import Body, Idm
from dohyo.agents.planning.situation import CLASS_OBJECT, CLASS_PEDESTRIAN, ROAD_BIT, ROUTE_BIT, Situation
from dohyo.sumo_networks import geometry
from dohyo.sumo_networks.arrays import FloatArray

project, pursuit, vehicle_step = uncounted(motion.project), uncounted(motion.pursuit), uncounted(motion.vehicle_step)
limited_steering, boxes_meet = uncounted(motion.limited_steering), uncounted(motion.boxes_meet)
idm_acceleration, wrap = uncounted(motion.idm_acceleration), uncounted(geometry.wrap)
at_row, leader = uncounted(around.at_row), uncounted(around.leader)
on_grid, box_on_grid = uncounted(around.on_grid), uncounted(around.box_on_grid)

X, Y, HEADING, SPEED, ACCELERATION, STEERING, DEMAND, S, LATERAL, OFF_ROAD = range(10)
STATE = 10
"""Rear axle x, y [m], heading [rad], speed [m/s], acceleration [m/s^2], wheel angle [rad], demanded acceleration
[m/s^2], arc length and lateral distance of the box centre on the path [m], 1 while it began off the road and is still
there."""
PROGRESS, COLLISION, MARGIN, ROUTE, ROAD, LINE, HEADING_TERM, CENTRING, COMFORT, GAP, MEETING = range(11)
TERMS = 11
TERM_NAMES = (
    "progress", "collision", "margin", "route", "road", "line", "heading", "centring", "comfort", "gap", "meeting"
)  # fmt: skip
ALIVE, FAILED = 0, 1
STANDING, MOVING = 0.1, 2.0
HALTING, STOPPING_S = -0.5, 0.8
BEHIND = -0.5
REACH_M = 4.0
MEETING_EVERY, MEETING_STEPS, MEETING_OVER = 2, 3, 5
"""Steps of 0.1 s between two looks for meetings; instants that each looks at; steps over which others' motion is taken.
"""
ON_FOOT_M = 0.5
"""Half the length that no person on foot has; a situation counts cyclists as people, too."""


@kernel
def controls(
    road: Situation, car: Body, rules: Rules, state: FloatArray, target: float, lateral: float
) -> tuple[float, float]:
    """Demand of a held action on the vehicle in the next 0.1 s.

    Args:
        road: The situation.
        car: The vehicle.
        rules: The numbers.
        state: (10,), see `STATE`.
        target: Acceleration of the action, m/s^2.
        lateral: Line beside the path [m], or wheel angle [rad].

    Returns:
        Demanded acceleration [m/s^2] and wheel angle [rad].
    """
    speed, most = state[SPEED], rules.jerk * DT
    row = at_row(road, state[S])
    # Never beyond the limit; a speed above it is reduced gently.
    target = min(target, max((road.limit[row] - speed) / 0.5, -1.5))
    # The last metres are braked gently, since a stop at full braking is a jolt.
    target = max(target, -max(speed / STOPPING_S, -HALTING))
    demand = min(max(target, state[DEMAND] - most), state[DEMAND] + most)
    if speed < STANDING and target <= 0.0:  # no creeping: a vehicle that hardly moves, and should not, comes to rest
        demand = min(demand, target, HALTING if speed > 0.0 else 0.0)
    if rules.lane_steering:
        x, y = state[X], state[Y]
        wheel = pursuit(car, road.path, road.first_s, road.spacing, x, y, state[HEADING], speed, state[S], lateral)
    else:
        wheel = lateral
    return demand, limited_steering(car, speed, wheel)


@kernel
def advance(
    road: Situation, car: Body, rules: Rules, state: FloatArray, first: int, accelerate: int, steer: int,
    before: int, terms: FloatArray,
) -> int:  # fmt: skip
    """Holds an action, in place.

    Args:
        road: The situation.
        car: The vehicle.
        rules: The numbers.
        state: (10,) before, and after; see `STATE`.
        first: Step of 0.1 s at which the action begins.
        accelerate: Index of the acceleration.
        steer: Index of the steering.
        before: Index of the acceleration before it.
        terms: (11,) where the terms of the reward are written.

    Returns:
        FAILED after a collision, off the road or beyond a closed line; else ALIVE.
    """
    for i in range(terms.shape[0]):
        terms[i] = 0.0
    target = (accelerate - MIDDLE) * rules.acceleration_step
    lateral = (steer - MIDDLE) * rules.steering_step
    began, hold = state[S], rules.hold_steps * DT
    near, front = False, 0.5 * car.length
    for step in range(rules.hold_steps):
        demand, wheel = controls(road, car, rules, state, target, lateral)
        state[DEMAND] = demand
        moved = vehicle_step(
            car, state[X], state[Y], state[HEADING], state[SPEED], state[ACCELERATION], state[STEERING], demand, wheel
        )
        state[X], state[Y], state[HEADING], state[SPEED], state[ACCELERATION], state[STEERING] = moved
        cos, sin = math.cos(state[HEADING]), math.sin(state[HEADING])
        x, y = state[X] + car.axle * cos, state[Y] + car.axle * sin
        behind_line = state[S] + front <= road.line
        s, side, row = project(road.path, road.first_s, road.spacing, x, y, state[S] + 0.1 * state[SPEED], REACH_M)
        state[S], state[LATERAL] = s, side
        time = (first + step + 1) * DT
        lost = rules.forfeit * (rules.depth * hold - time)
        hit = _touched(road, car, rules, x, y, cos, sin, state[SPEED], min(first + step + 1, road.boxes.shape[0] - 1))
        if hit >= 0:
            if state[SPEED] > STANDING:
                terms[COLLISION] = _collision(rules, road.kind[hit]) + lost
                return FAILED
            near = True
        elif hit == -2:
            near = True
        if behind_line and s + front > road.line:
            terms[LINE] = rules.penalty_line + lost
            return FAILED
        looks = rules.meeting_s > 0.0 and (first + step + 1) % MEETING_EVERY == 0 and state[SPEED] > STANDING
        if looks and _meets(road, car, rules, x, y, cos, sin, state[SPEED], first + step + 1):
            terms[MEETING] += rules.penalty_meeting * MEETING_EVERY * DT
        # Corners are looked up every half second and at the end: a lane's edge is not left and regained in between.
        if (step + 1) % 5 == 0 or step + 1 == rules.hold_steps:
            flags = box_on_grid(road.grid, x, y, cos, sin, 0.5 * car.length, 0.5 * car.width)
            if flags & ROAD_BIT:
                state[OFF_ROAD] = 0.0
            elif state[OFF_ROAD] == 0.0:
                terms[ROAD] = rules.penalty_road + lost
                return FAILED
            if step + 1 == rules.hold_steps:
                _settle(road, rules, state, terms, began, hold, x, y, row, near, accelerate, before)
                if state[SPEED] > STANDING:
                    terms[GAP] = rules.penalty_gap * hold * _gap_missing(road, car, rules, state, time)
    return ALIVE


@kernel
def _settle(
    road: Situation,
    rules: Rules,
    state: FloatArray,
    terms: FloatArray,
    began: float,
    hold: float,
    x: float,
    y: float,
    row: int,
    near: bool,
    accelerate: int,
    before: int,
) -> None:
    """Reward terms of an action that did not fail."""
    error = wrap(state[HEADING] - math.atan2(road.path[row, 3], road.path[row, 2]))
    on_route = on_grid(road.grid, x, y) & ROUTE_BIT
    # Standing costs nothing: otherwise a quick failure would end a lasting cost.
    moving = min(max((state[S] - began) / (MOVING * hold), 0.0), 1.0) if rules.standing_free else 1.0
    if near and state[SPEED] > STANDING:
        terms[MARGIN] = rules.penalty_margin * hold
    if state[OFF_ROAD] > 0.0:
        on_route = 0
    elif not on_route:
        terms[ROUTE] = rules.penalty_route * hold * moving
    if on_route and abs(error) < rules.heading_most:
        possible = max(road.limit[at_row(road, began)] * hold, 0.1)
        terms[PROGRESS] = min(max((state[S] - began) / possible, 0.0), 1.0) * hold
    terms[HEADING_TERM] = -rules.heading * abs(math.sin(error)) * hold * moving
    terms[CENTRING] = -rules.centring * min(abs(state[LATERAL]), 4.0) * hold * moving
    change = abs(accelerate - before) * rules.acceleration_step
    terms[COMFORT] = -rules.comfort * (abs(state[DEMAND]) + change) * hold
    if state[OFF_ROAD] > 0.0:
        terms[PROGRESS] = rules.bonus_return * min(max(state[S] - began, 0.0), 5.0)


@kernel
def _gap_missing(road: Situation, car: Body, rules: Rules, state: FloatArray, time: float) -> float:
    """Share of the safe distance that is missing: the leader may brake at any moment, independent of its forecast.

    Source: after Shalev-Shwartz et al. 2017, Responsibility-Sensitive Safety.
    """
    speed = state[SPEED]
    gap, leading = leader(
        road, 0.5 * car.length, 0.5 * car.width + rules.margin_across, state[S], time, state[LATERAL]
    )  # fmt: skip
    safe = rules.time_gap * speed + max(speed * speed - leading * leading, 0.0) / (2.0 * rules.braking)
    return 0.0 if gap >= safe else min((safe - gap) / safe, 1.0)


@kernel
def _collision(rules: Rules, kind: int) -> float:
    if kind == CLASS_PEDESTRIAN:
        return rules.penalty_pedestrian
    return rules.penalty_object if kind == CLASS_OBJECT else rules.penalty_vehicle


@kernel
def _touched(
    road: Situation, car: Body, rules: Rules, x: float, y: float, cos: float, sin: float, speed: float, step: int
) -> int:
    """Index of the actor the ego touches, -2 where one is within the margins only, -1 for none.

    Actors behind the ego's rear are left out: they have to keep their own distance.
    """
    half_length, half_width = 0.5 * car.length, 0.5 * car.width
    ahead = rules.margin_along + rules.headway * speed
    reach = math.hypot(half_length, half_width) + ahead + rules.margin_people
    near = False
    for n in range(road.boxes.shape[1]):
        ox, oy = road.boxes[step, n, 0], road.boxes[step, n, 1]
        dx, dy = ox - x, oy - y
        far = reach + road.reach[n]
        if dx * dx + dy * dy > far * far:
            continue
        if dx * cos + dy * sin < -half_length + BEHIND:
            continue
        oc, os, ol, ow = road.boxes[step, n, 2], road.boxes[step, n, 3], road.boxes[step, n, 4], road.boxes[step, n, 5]
        skin = rules.skin_across
        if road.kind[n] == CLASS_PEDESTRIAN and ol < ON_FOOT_M:
            skin += rules.skin_people * speed
        if boxes_meet(x, y, cos, sin, half_length + rules.skin_along, half_width + skin, ox, oy, oc, os, ol, ow):
            return n
        shift = 0.5 * ahead
        across = rules.margin_people if road.kind[n] == CLASS_PEDESTRIAN else rules.margin_across
        if not near and boxes_meet(
            x + shift * cos, y + shift * sin, cos, sin, half_length + shift, half_width + across,
            ox, oy, oc, os, ol, ow,
        ):  # fmt: skip
            near = True
    return -2 if near else -1


@kernel
def _meets(
    road: Situation, car: Body, rules: Rules, x: float, y: float, cos: float, sin: float, speed: float, step: int
) -> bool:
    """Whether the ego meets an actor that is not behind it within `meeting_s`, if both keep speed and heading."""
    half_length, half_width = 0.5 * car.length, 0.5 * car.width
    radius = math.hypot(half_length, half_width)
    now = min(step, road.boxes.shape[0] - 1)
    before = max(now - MEETING_OVER, 0)
    scale = rules.meeting_s / ((now - before) * DT)
    for n in range(road.boxes.shape[1]):
        ox, oy = road.boxes[now, n, 0], road.boxes[now, n, 1]
        dx, dy = ox - x, oy - y
        if dx * cos + dy * sin < 0.0:
            continue
        rx = (ox - road.boxes[before, n, 0]) * scale - speed * rules.meeting_s * cos
        ry = (oy - road.boxes[before, n, 1]) * scale - speed * rules.meeting_s * sin
        far = radius + road.reach[n] + math.hypot(rx, ry)
        if dx * dx + dy * dy > far * far:
            continue
        oc, os, ol, ow = road.boxes[now, n, 2], road.boxes[now, n, 3], road.boxes[now, n, 4], road.boxes[now, n, 5]
        for k in range(1, MEETING_STEPS + 1):
            mx, my = ox + rx * k / MEETING_STEPS, oy + ry * k / MEETING_STEPS
            if boxes_meet(x, y, cos, sin, half_length, half_width, mx, my, oc, os, ol, ow):
                return True
    return False


@kernel
def crafted_centre(road: Situation, car: Body, rules: Rules, idm: Idm, state: FloatArray, time: float) -> int:
    """Index of the acceleration on which the crafted prior is centred."""
    speed = state[SPEED]
    row = at_row(road, state[S] + speed * 0.5)
    if rules.crafted == 1:
        return MIDDLE + 2 if speed < road.limit[row] - 0.5 * rules.acceleration_step else MIDDLE
    target = road.allowed[row]
    gap, leading = leader(road, 0.5 * car.length, 0.5 * car.width + rules.margin_across, state[S], time + 0.5, 0.0)
    wish = idm_acceleration(idm, speed, target, gap, leading)
    if speed > target:
        wish = min(wish, max((target - speed) / 1.0, -idm.hardest))
    to_line = road.line - state[S] - 0.5 * car.length - rules.line_gap
    if to_line > -1.0 and road.line < 1e8:
        wish = min(wish, idm_acceleration(idm, speed, max(target, 1.0), max(to_line + idm.gap, 0.05), 0.0))
    index = MIDDLE + math.floor(wish / rules.acceleration_step + 0.5)
    return min(max(index, 0), ACTIONS - 1)
