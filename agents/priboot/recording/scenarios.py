"""Scenarios: what an order of a recording drives; each follows from its network, its number and the seed alone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

import numpy as np

from dohyo.agents.mcts.predictors import recording as motion
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.events.auto_events import EVERY_M, auto_events
from dohyo.sumo_networks.events.registry import Event
from dohyo.sumo_networks.networks.catalog import load_network
from dohyo.sumo_networks.networks.network import RoadNetwork
from dohyo.sumo_networks.routes.routing import plan_route
from dohyo.sumo_networks.scenario import Scenario

NETWORKS = ("town-train", "district", "braunschweig", "ingolstadt")
"""Adlershof and town-test judge, and are never recorded."""
OBSTACLES: Final[Mapping[str, tuple[str, ...]]] = MappingProxyType(
    {
        "lanes": (
            "accident",
            "accident_two_ways",
            "construction",
            "construction_two_ways",
            "parked_obstacle",
            "parked_obstacle_two_ways",
        ),
        "doors": ("vehicle_opens_door",),
    }
)
"""Kinds of events before which the lane must be left, and before which the ego moves aside in it."""
GAPS_M: Final = (None, (100.0, 300.0), None, (50.0, 150.0))
"""Gaps in the oncoming traffic beside obstacles, in turn; None: none comes. The autopilot seldom takes the
events' own, 20 to 50 m, within an episode."""
OFTEN_M = (60.0, 120.0)
"""Smallest and largest distance between two obstacles where routes have nothing else."""
THINNER: Final = 8
"""Share of the usual traffic where routes have nothing but obstacles: others queue up behind these, too."""


@dataclass(frozen=True, slots=True)
class MomentRequest:
    """Order of a recording.

    Attributes:
        samples: Moments for training and validation, at least.
        seed: Of all randomness.
        egos: Number per episode.
        every_s: Between two moments of one ego.
        episode_s: How long an episode lasts.
        demonstrator: Registered name of the agent that drives; its actions are acceleration and steering.
        learner: ONNX file of a policy from which it takes over, instead of noise; "": none.
        obstacles: Of `OBSTACLES`: every route has them, one each 60 to 120 m, and nothing else; "": the leaderboard's
            events on half of the routes.
    """

    samples: int = 30_000
    seed: int = 0
    egos: int = 6
    every_s: float = 0.3
    episode_s: float = 90.0
    demonstrator: str = "autopilot"
    learner: str = ""
    obstacles: str = ""


def scenario(order: MomentRequest, name: str, number: int) -> Scenario:
    """The scenario of one episode: missions and traffic as in the motion dataset, with events on every other route.

    With events on every route, egos stand for most of an episode, and a learner of their drives stands, too. On half of
    the routes with events these are obstacles in the lane: of all kinds they are a fifth, and a learner of so few ways
    round them stops for good.

    Raises:
        InvalidInputError: The network has too few missions.
    """
    drawn = motion.scenario(motion.MotionRequest(seed=order.seed, egos=order.egos), name, number)
    network = load_network(name)
    events = [event for place in range(order.egos) for event in _events(order, network, drawn, place, number)]
    vehicles = drawn.traffic.vehicles // (THINNER if order.obstacles else 1)
    traffic = drawn.traffic.model_copy(update={"vehicles": vehicles})
    return drawn.model_copy(update={"name": f"priboot-{name}-{number}", "events": tuple(events), "traffic": traffic})


def _events(order: MomentRequest, network: RoadNetwork, drawn: Scenario, place: int, number: int) -> list[Event]:
    """Events on the route of one ego; none on every other route, nor where no kind fits on a short one."""
    mission = drawn.missions[place]
    seed = int(np.random.SeedSequence(drawn.seed, spawn_key=(place,)).generate_state(1)[0])
    try:
        if order.obstacles:
            kinds = OBSTACLES[order.obstacles]
            found = auto_events(network, plan_route(network, mission), seed, kinds, OFTEN_M, mission.name)
            return [_with_gaps(event, place + at) for at, event in enumerate(found)]
        if place % 2 != number % 2:
            return []
        blocked = (place // 2 + number) % 2 == 0
        some = (*OBSTACLES["lanes"], *OBSTACLES["doors"]) if blocked else None
        return [*auto_events(network, plan_route(network, mission), seed, some, EVERY_M, mission.name)]
    except InvalidInputError:
        return []


def _with_gaps(event: Event, number: int) -> Event:
    """An obstacle with one of `GAPS_M` in the traffic that comes towards who passes it, if there is any."""
    if getattr(event, "gap_m", None) is None:
        return event
    return event.model_copy(update={"gap_m": GAPS_M[number % len(GAPS_M)]})
