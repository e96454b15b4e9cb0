"""Settings of the planner, and the numbers that its kernels take from them, each with its source."""

from __future__ import annotations

from typing import Annotated, Literal, NamedTuple

from pydantic import Field

from dohyo.agents.mcts.predicting import PREDICTORS
from dohyo.evaluation.settings import OneOf
from dohyo.sumo_networks.scenario import Config

Prior = Literal["none", "learned", "crafted", "both"]
Constraints = Literal["none", "tree", "node", "both"]
Choice = Literal["visits", "q", "best"]
Crafted = Literal["limit", "idm"]
Steering = Literal["lane", "wheel"]
Simulator = Literal["ours", "thesis"]
Walks = Literal["horizon", "node"]

ACTIONS = 13
"""Number of accelerations and of steering values, from which an action has one each (thesis)."""
MIDDLE = 6
"""Index of no acceleration, and of straight on: the line of the route, or wheels that point ahead (thesis)."""
LARGEST, LARGEST_PASSING = 10, 12
"""Index of the largest acceleration allowed: 2 m/s^2 (the thesis's code gives the two above it a prior of 0), and 3
m/s^2 while the ego passes an obstacle (ours)."""
ASIDE, SWERVING_M_S = 2, 5.0
"""Of `Settings.keeps_lane` (ours): how many lines to either side of the route are allowed, the second of which is a
metre away; and the speed from which no others are, m/s. Below that speed the hardest action stops in time, and the ego
may go round what stands half in its lane."""
HORIZON_S = 8.0
"""How far a search looks ahead (thesis: 6 to 8 s; its code: 8 s)."""
DT = 0.1
"""Step of the inner simulator, s (thesis)."""


class Settings(Config):
    """Settings of the planner: the arms of the ablations.

    Attributes:
        predictor: Name of what forecasts the others, and the ego for the learned prior; see `predicting`.
        prior: Which priors there are; two are averaged (thesis: both, added). "none": all actions are equal.
        crafted: What the crafted prior is centred on, with steering straight on: "limit", +1 m/s^2 below the limit,
            else 0 (the thesis's code); "idm", the acceleration IDM would choose (ours).
        learned_prior_s: For how long the learned prior holds (thesis: 1 s, so at the root alone); 0: never.
        prior_variance: sigma^2 of the priors' Gaussians over index distance (thesis: 100, almost uniform). Below 0.2
            those of actions far from all that are allowed would be 0 in double precision.
        constraints: Which continuity constraints hold: "tree", the first action is near the one executed before;
            "node", each further action is near the one above it (thesis: both). See `Rules` for how near.
        steering: What the 13 steering values are. "wheel": front wheel angles pi/24 apart (thesis); "lane": lines 0.5 m
            apart beside the route, which pure pursuit steers to (ours).
        simulator: Inner vehicle and reward. "thesis": the demanded acceleration may jump, 10 m/s^2 are allowed
            sideways, boxes are inflated, a failure forfeits nothing, there is no safe distance and no `looks_ahead`,
            standing beside the centreline costs, and accelerations and their changes are charged in the selection
            instead of the reward; "ours": see CHOICES.md.
        walks: What a simulation adds: "node", one node, evaluated at once (thesis); "horizon", all nodes of a walk to
            the horizon (ours).
        hold_s: How long an action is held (thesis: 1 s; 0.1 s as its ablation).
        simulations: Of a search (thesis: 256). A decision has a second search where `emergency` asks for it.
        budget_ms: A decision stops searching after that much wall-clock time, looked at every 16 simulations; None:
            never. Decisions then depend on the machine, and are not reproducible.
        first_play: Q of an action not yet tried: "zero" (thesis), or "parent", the mean return below its parent (ours).
        choice: How the plan is read from the tree. "visits", the most visits, of which every rollout below that reached
            the horizon without failure counts 10 more (the thesis's code); "q", the highest mean return (its text);
            "best", the actions of the best rollout (ours).
        early_stop: End the search if the rollout that follows the prior alone reaches the horizon without failure (the
            thesis's code).
        reuse: Search first along the plan of the tick before (ours).
        emergency: Where the plan fails within 2 s, search again as if the ego had been braking, unless `constraints`
            leave the root free; where that plan does, too, brake hard (ours; the brake is PDM's idea).
        caution: Actors ahead in the lane are not expected to clear it early, see `caution` (ours).
        passing: Go round what stands in the lane, along a path shifted to the side, see `agents.experts.detour` (ours).
        keeps_lane: With lines as steering, the ego stays within a metre of its line at 5 m/s or more, unless it passes
            something or comes back from it. What the hardest action cannot avoid it brakes for harder, instead of
            leaving its lane (ours).
        room_for_people: To pass people on foot nearer than a distance that grows with the speed counts as a collision
            (ours).
        drives_off: `reuse` does not keep a plan by which a standing ego goes on standing, since the ego might wait for
            ever for the best moment to go (ours).
        looks_ahead: To be about to meet somebody who is not behind within 1.3 s, if both keep speed and heading, costs
            10 per second (ours; nuPlan's score asks for 0.95 s).
        value: "network" ends walks early, and adds the value network's estimate (ours).
        value_depth_s: Depth at which walks then end, s.
    """

    predictor: Annotated[str, OneOf(PREDICTORS)] = "learned"
    prior: Prior = "both"
    crafted: Crafted = "idm"
    learned_prior_s: Annotated[float, Field(ge=0, le=HORIZON_S)] = 1.0
    prior_variance: Annotated[float, Field(ge=0.2, le=1e6)] = 100.0
    constraints: Constraints = "both"
    steering: Steering = "lane"
    simulator: Simulator = "ours"
    walks: Walks = "horizon"
    hold_s: Annotated[float, Field(ge=0.1, le=2.0, multiple_of=0.1)] = 1.0
    simulations: Annotated[int, Field(ge=1, le=100_000)] = 256
    budget_ms: Annotated[float, Field(gt=0, le=600_000)] | None = None
    first_play: Literal["zero", "parent"] = "parent"
    choice: Choice = "best"
    early_stop: bool = False
    reuse: bool = True
    emergency: bool = True
    caution: bool = True
    passing: bool = True
    keeps_lane: bool = True
    room_for_people: bool = True
    drives_off: bool = True
    looks_ahead: bool = True
    value: Literal["none", "network"] = "none"
    value_depth_s: Annotated[float, Field(ge=2.0, lt=HORIZON_S)] = 4.0


class Rules(NamedTuple):
    """Numbers of the inner simulator and of the search, as the kernels take them.

    Attributes:
        hold_steps: Steps of 0.1 s for which an action is held.
        depth: Actions to the horizon.
        bootstrap: Actions after which a walk ends and the value network is evaluated; 0: never.
        acceleration_step: Between two accelerations, m/s^2 (thesis: -3 to 3 in steps of 0.5).
        steering_step: Between two wheel angles, rad (thesis: pi/24); with `lane_steering`, between two lines, m (ours).
        lane_steering: 1 where steering values are lines beside the route.
        jerk: The demanded acceleration changes by at most this much, m/s^3 (ours: comfort allows 4.13; thesis: any).
        exploration: c of PUCT (thesis: 2).
        root_window: The indices of the first action differ by less than this from those of the action executed before
            (the thesis's code: 5).
        node_window: Those of each further action differ by less than this from those of the action above it (the
            thesis's code: 3; its text: 4, so 7 x 7 actions).
        largest: Index of the largest acceleration allowed.
        aside: Steering indices that are allowed to either side of `MIDDLE`.
        standing: Below this speed the windows do not bind the acceleration, m/s (the thesis's code gives "extra
            freedom").
        variance: sigma^2 of the priors (thesis: 100); kernels take the Gaussian itself, `prior.kernel`.
        crafted: 0 none, 1 towards the limit, 2 IDM.
        parent_first: 1 where an untried action has the value of its parent.
        one_node: 1 where a simulation adds one node.
        effort: Charged in the selection below the root, per step of 0.5 m/s^2 (the thesis's code: 1/10 per m/s^2).
        effort_change: The same per step between two accelerations (the thesis's code: 1/5).
        penalty_pedestrian: Collision with a pedestrian or cyclist (thesis's text; its code: -3).
        penalty_vehicle: With a vehicle (thesis).
        penalty_object: With an object (thesis).
        penalty_margin: Per second, an actor within the margins while the ego moves (the thesis's code).
        penalty_gap: Per second, times the share of the safe distance to the leader that is missing (ours).
        penalty_meeting: Per second in which the ego is about to meet somebody, see `meeting_s` (ours).
        forfeit: Per second left to the horizon after a failure (ours; thesis: none). Failures end a walk: a collision
            of a moving ego, leaving the drivable area, passing a closed line.
        penalty_route: Per second, the centre not on the route's roads (thesis).
        penalty_road: Once, a corner off the drivable area (thesis).
        penalty_line: Once, past a closed line: off the route and off the road, since lanes behind a red light are
            closed (thesis: the sum of both).
        bonus_return: Per metre along the path, of which an action counts 5 at most, while an ego that began off the
            road is still there; it has no other progress (the thesis's code: "a small bonus").
        heading: Per second, weight of |sin| of the heading error (thesis: 1/2, without the absolute value).
        centring: Per second, weight of the distance to the centreline, 4 m at most, 1/m (thesis: 1/2).
        heading_most: Heading error beyond which no progress counts, rad (the thesis's code: 0.20).
        comfort: Per second, weight of |demanded acceleration| in m/s^2 plus its change between two actions (ours; the
            thesis: see `effort`).
        standing_free: 1 where heading, centring and route cost in proportion to the progress up to 2 m/s, and nothing
            while the ego stands (ours).
        margin_along: Ahead of the ego's box, m (the thesis's code: 0.7).
        margin_across: Beside it, m (the thesis's code: 0.3).
        margin_people: Beside it to people on foot or bicycle, m (ours).
        headway: `margin_along` grows by this times the speed, s (the thesis's code: 1/2 on the length, so 1/4).
        time_gap: Time gap in the safe distance, s (the thesis's code: v/2 on the length).
        braking: Deceleration of ego and leader in the rest of the safe distance, m/s^2 (ours, after RSS; nearly the
            hardest braking that comfort allows, 4.05).
        skin_along: Distance between boxes that counts as a collision, beyond both ends of the ego's box, m (ours: 0.1,
            as forecasts are not exact; the thesis's code: 0.7).
        skin_across: Beside it, m (ours: 0.1; the thesis's code: 0.3).
        skin_people: `skin_across` grows by this times the speed for people on foot, s (ours: a metre at 50 km/h).
        meeting_s: Time within which an actor that is not behind and keeps speed and heading is about to be met; 0: no
            such cost.
        line_gap: Distance of the front to a closed line at a stop, m (ours).
    """

    hold_steps: int
    depth: int
    bootstrap: int
    acceleration_step: float
    steering_step: float
    lane_steering: int
    jerk: float
    exploration: float
    root_window: int
    node_window: int
    largest: int
    aside: int
    standing: float
    variance: float
    crafted: int
    parent_first: int
    one_node: int
    effort: float
    effort_change: float
    penalty_pedestrian: float
    penalty_vehicle: float
    penalty_object: float
    penalty_margin: float
    penalty_gap: float
    penalty_meeting: float
    forfeit: float
    penalty_route: float
    penalty_road: float
    penalty_line: float
    bonus_return: float
    heading: float
    centring: float
    heading_most: float
    comfort: float
    standing_free: int
    margin_along: float
    margin_across: float
    margin_people: float
    headway: float
    time_gap: float
    braking: float
    skin_along: float
    skin_across: float
    skin_people: float
    meeting_s: float
    line_gap: float


MAX_SPEED = 13.9
"""Highest speed whatever the limit, m/s: 50 km/h (ours; the thesis's code: 13.4)."""
CURVE_LATERAL = 2.5
"""Lateral acceleration up to which the crafted prior drives curves, m/s^2 (ours)."""
CURVE_BRAKING = 2.0
"""Deceleration with which it slows down for them, m/s^2 (ours)."""
LATERAL_LIMIT, LATERAL_MASK = 4.4, 10.0
"""The most lateral acceleration that steering asks for, m/s^2, so that a faster ego runs wide: of the simulators "ours"
and "thesis", whose number is that of the thesis's code. The tyres' limit is 8.8 here, comfort's 4.89."""
UNBOUNDED = 1e9
"""`Rules.jerk` where the demanded acceleration may jump."""
EMERGENCY_S, EMERGENCY_BRAKING = 2.0, 8.0
"""If a plan fails within that time, s, the ego brakes with that deceleration, m/s^2 (ours; the time is PDM's)."""
HARDEST, LET_GO = 3.0, 0.65
"""The deceleration of the hardest action, m/s^2. After an emergency the brakes are let go down to it faster than the
bounded jerk allows: by that much more per tick, m/s^2 (ours)."""
PERFECT_BONUS = 10
"""Further visits that a rollout without failure counts for in the final choice (the thesis's code)."""

FREE = 2 * ACTIONS
"""A window that holds every action."""
_CRAFTED = {"limit": 1, "idm": 2}


def rules(settings: Settings) -> Rules:
    """Numbers of the kernels for given settings."""
    lane, ours = settings.steering == "lane", settings.simulator == "ours"
    crafted = _CRAFTED[settings.crafted] if settings.prior in ("crafted", "both") else 0
    return Rules(
        hold_steps=round(settings.hold_s / DT),
        depth=round(HORIZON_S / settings.hold_s),
        bootstrap=round(settings.value_depth_s / settings.hold_s) if settings.value == "network" else 0,
        acceleration_step=0.5,
        steering_step=0.5 if lane else 0.1308996938995747,
        lane_steering=int(lane),
        jerk=3.5 if ours else UNBOUNDED,
        exploration=2.0,
        root_window=5 if settings.constraints in ("tree", "both") else FREE,
        node_window=3 if settings.constraints in ("node", "both") else FREE,
        largest=LARGEST,
        aside=ASIDE if lane and settings.keeps_lane else MIDDLE,
        standing=0.5,
        variance=settings.prior_variance,
        crafted=crafted,
        parent_first=int(settings.first_play == "parent"),
        one_node=int(settings.walks == "node"),
        effort=0.0 if ours else 0.05,
        effort_change=0.0 if ours else 0.2,
        penalty_pedestrian=-5.0,
        penalty_vehicle=-5.0,
        penalty_object=-2.0,
        penalty_margin=-0.5,
        penalty_gap=-3.0 if ours else 0.0,
        penalty_meeting=-10.0,
        forfeit=-1.0 if ours else 0.0,
        penalty_route=-0.5,
        penalty_road=-1.0,
        penalty_line=-1.5,
        bonus_return=0.05,
        heading=0.5,
        centring=0.5,
        heading_most=0.2,
        comfort=0.02 if ours else 0.0,
        standing_free=int(ours),
        margin_along=0.7,
        margin_across=0.3,
        margin_people=1.0 if ours else 0.3,
        headway=0.25,
        time_gap=0.5,
        braking=4.0,
        skin_along=0.1 if ours else 0.7,
        skin_across=0.1 if ours else 0.3,
        skin_people=0.07 if settings.room_for_people else 0.0,
        meeting_s=1.3 if ours and settings.looks_ahead else 0.0,
        line_gap=0.3,
    )
