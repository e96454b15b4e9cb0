"""Every number of the planner, with its source."""

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
"""Values of either part of an action (thesis)."""
MIDDLE = 6
"""Index of no acceleration, and of no deviation (thesis)."""
LARGEST, LARGEST_PASSING = 10, 12
"""Index of the largest acceleration allowed, 2 m/s^2 (the thesis's code gives the two above it a prior of 0); 3 m/s^2
while the ego passes an obstacle (ours)."""
ASIDE, SWERVING_M_S = 2, 5.0
"""Steps of steering to either side that keep the ego in its lane, a metre; and the speed from which it keeps it (ours):
more slowly the hardest action stops in time, and what stands half in the lane can be gone round."""
HORIZON_S = 8.0
"""Thesis: 6 to 8 s; its code: 8 s."""
DT = 0.1


class Settings(Config):
    """Settings of the planner: the arms of the ablations.

    Attributes:
        predictor: Name of the predictor, see `dohyo.agents.mcts.predictors`.
        prior: Which priors are summed (thesis: both).
        crafted: What the crafted prior is centred on: "limit", +1 m/s^2 while below the limit, else 0 (the thesis's
            code); "idm", the acceleration IDM would choose (ours).
        learned_prior_s: For how long the learned prior holds (thesis: 1 s, so at the root alone).
        prior_variance: sigma^2 of the priors' Gaussians over index distance (thesis: 100, almost uniform).
        constraints: Which continuity constraints hold (thesis: both).
        steering: What the 13 steering values are. "wheel": front wheel angles pi/24 apart (thesis); "lane": lines 0.5 m
            apart beside the route, which pure pursuit steers to (ours).
        simulator: Inner vehicle and reward. "thesis": demands may jump, 10 m/s^2 are allowed sideways, boxes are
            inflated, a failure forfeits nothing, no safe distance, standing beside the centreline costs, and changes
            of the acceleration are charged in the selection; "ours": see CHOICES.md.
        walks: What a simulation adds: "node", one node, evaluated at once (thesis); "horizon", all nodes of a walk to
            the horizon (ours).
        hold_s: How long an action is held (thesis: 1 s; 0.1 s as its ablation).
        simulations: Per decision (thesis: 256).
        budget_ms: Stops after that much wall-clock time; None: never. Decisions then depend on the machine, and are not
            reproducible.
        first_play: Q of an action not yet tried: "zero" (thesis), or "parent", the mean of its parent (ours).
        choice: Most visits and 10 for every perfect rollout below (the thesis's code), "q" the highest mean return (its
            text), or "best", the first action of the best rollout (ours).
        early_stop: End the search if the very first rollout is perfect (the thesis's code).
        reuse: Search first along the plan of the tick before (ours).
        emergency: Where the plan fails soon, search again as if the ego had been braking, and else brake hard (ours;
            the brake is PDM's idea).
        caution: Actors ahead in the lane are not expected to clear it early, see `caution` (ours).
        passing: Go round what stands in the lane, along a path shifted to the side, see `detour` (ours).
        keeps_lane: Stays within a metre of its line at 5 m/s or more, unless it passes something or comes back from it.
            What the hardest action cannot avoid it brakes for harder, instead of leaving its lane (ours).
        room_for_people: To pass people on foot nearer than a distance that grows with the speed counts as a collision
            (ours).
        drives_off: A plan by which a standing ego goes on standing is not searched along at the next tick, so that it
            does not wait for ever for the best moment to go (ours).
        looks_ahead: To be about to meet somebody within 1.3 s, if both keep speed and heading, costs 10 per second
            (ours; nuPlan's score asks for 0.95 s).
        value: "network" ends walks early, and adds the value network's estimate (ours).
        value_depth_s: Depth at which walks then end, s.
    """

    predictor: Annotated[str, OneOf(PREDICTORS)] = "learned"
    prior: Prior = "both"
    crafted: Crafted = "idm"
    learned_prior_s: Annotated[float, Field(ge=0, le=HORIZON_S)] = 1.0
    prior_variance: Annotated[float, Field(gt=0, le=1e6)] = 100.0
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
        hold_steps: Steps of 0.1 s an action is held.
        depth: Actions to the horizon.
        bootstrap: Actions after which a walk ends and the value network is evaluated; 0: never.
        acceleration_step: Between two accelerations, m/s^2 (thesis: -3 to 3 in steps of 0.5).
        steering_step: Between two wheel angles, rad (thesis: pi/24); with `lane_steering`, between two lines, m (ours).
        lane_steering: 1 where steering values are lines beside the route.
        jerk: The demanded acceleration changes by at most this much, m/s^3 (ours: comfort allows 4.13; thesis: any).
        exploration: c of PUCT (thesis: 2).
        root_window: Index distance at the root, exclusive (the thesis's code: 5).
        node_window: Index distance below it, exclusive (the thesis's code: 3; its text: 4, so 7 x 7).
        largest: Index of the largest acceleration allowed.
        aside: Index distance of steering to either side that is allowed.
        standing: Below this speed acceleration is unconstrained, m/s (the thesis's code gives "extra freedom").
        variance: sigma^2 of the priors (thesis: 100).
        crafted: 0 none, 1 towards the limit, 2 IDM.
        parent_first: 1 where an untried action has the value of its parent.
        one_node: 1 where a simulation adds one node.
        effort: Charged in the selection below the root, per step of 0.5 m/s^2 (the thesis's code: 1/10 per m/s^2).
        effort_change: The same per step between two accelerations (the thesis's code: 1/5).
        penalty_pedestrian: Collision with a pedestrian or cyclist (thesis's text; its code: -3).
        penalty_vehicle: With a vehicle (thesis).
        penalty_object: With an object (thesis).
        penalty_margin: An actor within the margins (the thesis's code).
        penalty_gap: Per second, times the share of the safe distance to the leader that is missing (ours).
        penalty_meeting: Per second in which the ego is about to meet somebody, see `meeting_s` (ours).
        forfeit: Per second left to the horizon after a failure, which ends a walk (ours; thesis: none).
        penalty_route: Not on the route's roads (thesis).
        penalty_road: Off the drivable area (thesis).
        penalty_line: Over a closed line: off the route and off the road, since lanes behind a red light are closed
            (thesis: the sum of both).
        bonus_return: Per second on the road, for an ego that began off it (the thesis's code: "a small bonus").
        heading: Weight of |sin| of the heading error (thesis: 1/2, without the absolute value).
        centring: Weight of the distance to the centreline, 1/m (thesis: 1/2).
        heading_most: Heading error beyond which no progress counts, rad (the thesis's code: 0.20).
        comfort: Weight of |acceleration| in m/s^2 and of its change between actions (ours; the thesis: see `effort`).
        standing_free: 1 where standing beside the centreline, or off the route, costs nothing (ours).
        margin_along: Beyond the ends of the ego's box, m (the thesis's code: 0.7).
        margin_across: Beside it, m (the thesis's code: 0.3).
        margin_people: Beside it to people on foot or bicycle, m (ours).
        headway: The margin ahead grows by this times the speed, s (the thesis's code: 1/2 on the length, so 1/4).
        time_gap: Time gap in the safe distance, s (the thesis's code: v/2 on the length).
        braking: Deceleration of ego and leader in the rest of the safe distance, m/s^2 (ours, after RSS; the hardest
            braking that comfort allows).
        skin_along: Distance between boxes that counts as a collision, beyond the ends of the ego's box, m (ours: 0.1,
            as forecasts are not exact; the thesis's code: 0.7).
        skin_across: Beside it, m (ours: 0.1; the thesis's code: 0.3).
        skin_people: What the speed adds to it for people on foot, s (ours: a metre at 50 km/h).
        meeting_s: Time within which an actor ahead that keeps speed and heading is about to be met; 0: no such cost.
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
"""m/s (ours; the thesis's code: 13.4). 50 km/h."""
CURVE_LATERAL = 2.5
"""Lateral acceleration up to which the crafted prior drives curves, m/s^2 (ours)."""
CURVE_BRAKING = 2.0
"""Deceleration with which it slows down for them, m/s^2 (ours)."""
LATERAL_LIMIT, LATERAL_MASK = 4.4, 10.0
"""Lateral acceleration beyond which the inner vehicle runs wide, m/s^2: ours, and the thesis's code's. The tyres' limit
is 8.8 here, comfort's 4.89."""
UNBOUNDED = 1e9
EMERGENCY_S, EMERGENCY_BRAKING = 2.0, 8.0
"""If a plan fails within that time, s, the ego brakes with that deceleration, m/s^2 (ours; the time is PDM's)."""
HARDEST, LET_GO = 3.0, 0.65
"""The hardest action's deceleration, m/s^2, and by how much more than the bounded jerk an emergency's brakes are let go
in a tick until they are down to it, m/s^2 (ours)."""
PERFECT_BONUS = 10
"""Visits that a perfect rollout counts for in the final choice (the thesis's code)."""

FREE = 2 * ACTIONS
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
