"""Scenarios of endless driving: a chain of random goals through the training town, in random traffic and conditions.

    scenario = draw_scenario("traffic", seed=7, endless=True)

Everything follows from roads and seed. Towns and conditions that `nocrash` judges with are never drawn.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from dohyo.agents.endless_driving.config import Roads
from dohyo.evaluation.benchmarks.mission_drawing import unfit
from dohyo.sumo_networks.conditions import TRAIN
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.networks.catalog import load_network
from dohyo.sumo_networks.networks.lights import endless_lights
from dohyo.sumo_networks.networks.network import RoadNetwork
from dohyo.sumo_networks.routes.route import Route
from dohyo.sumo_networks.routes.routing import plan_route
from dohyo.sumo_networks.scenario import Mission, Place, Scenario, Traffic

TOWN: Final = "town-train"
GOALS: Final = 2
"""Goals before the last one, of an endless route."""
ENDLESS_M: Final = (700.0, 4000.0)
"""Lengths of endless routes: longer than an ego drives within the time limit."""
MISSION_M: Final = (120.0, 400.0)
ENDLESS_S: Final = 100.0
"""Time limit of a training episode."""
SLOWEST_M_S, EXTRA_S = 5.0 / 3.6, 20.0
"""Time limit of a mission, as in `nocrash`."""
MOST_VEHICLES, MOST_PEDESTRIANS = 100, 250
"""Most traffic in training: that of the dense cells of `nocrash`."""
WARM_UP_S: Final = 10.0
ATTEMPTS: Final = 500
_DRAWN, _OVERFITTED = 0, 3
"""Streams of random numbers: of all missions, and of the one that "one-route" repeats."""


def draw_scenario(roads: Roads, seed: int, *, endless: bool) -> Scenario:
    """The scenario of one episode.

    Args:
        roads: See `Roads`.
        seed: Of everything.
        endless: Whether goal follows goal until the time is over; otherwise there is one goal.

    Raises:
        InvalidInputError: No route was found within `ATTEMPTS` draws.
    """
    one = roads == "one-route"
    rng = np.random.default_rng([_OVERFITTED, 0] if one else [_DRAWN, seed])
    network = load_network(TOWN)
    mission, route = _draw_mission(rng, network, endless=endless and not one)
    vehicles = int(rng.integers(MOST_VEHICLES + 1)) if roads == "traffic" else 0
    pedestrians = int(rng.integers(MOST_PEDESTRIANS + 1)) if roads == "traffic" else 0
    limit_s = ENDLESS_S if endless else route.length / SLOWEST_M_S + EXTRA_S
    return Scenario(
        name=f"{roads}-{seed}",
        cell=roads,
        network=TOWN,
        missions=(mission,),
        traffic=Traffic(vehicles=vehicles, pedestrians=pedestrians, warm_up_s=WARM_UP_S if vehicles else 0.0),
        conditions="clear" if one else str(rng.choice(sorted(TRAIN))),
        time_limit_s=round(limit_s, 1),
        seed=seed,
    )


def _draw_mission(rng: np.random.Generator, network: RoadNetwork, *, endless: bool) -> tuple[Mission, Route]:
    """A mission that a lawful driver can drive, with its route."""
    low, high = ENDLESS_M if endless else MISSION_M
    never_green = endless_lights(network)
    for _ in range(ATTEMPTS):
        goals = tuple(_edge_of(network, _lane(rng, network)) for _ in range(GOALS if endless else 0))
        mission = Mission(start=_anywhere(rng, network), goal=_anywhere(rng, network), via=goals)
        try:
            route = plan_route(network, mission)
        except InvalidInputError:
            continue
        if low <= route.length <= high and unfit(network, route, never_green) is None:
            return mission, route
    raise InvalidInputError(f"network '{network.name}': no route of {low:g} to {high:g} m in {ATTEMPTS} draws")


def _anywhere(rng: np.random.Generator, network: RoadNetwork) -> Place:
    lane = _lane(rng, network)
    position = float(rng.uniform(8.0, network.lanes.length[lane] - 15.0))
    return Place(lane=str(network.lanes.ids[lane]), position_m=round(position, 1))


def _lane(rng: np.random.Generator, network: RoadNetwork) -> int:
    return int(rng.choice(network.lanes.longer_than(40.0)))


def _edge_of(network: RoadNetwork, lane: int) -> str:
    return str(network.lanes.ids[lane]).rpartition("_")[0]
