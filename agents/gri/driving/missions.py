"""Missions of the driving task: between any two places of the town of training, in any traffic, from a seed."""

from __future__ import annotations

import zlib
from typing import Final

import numpy as np

from dohyo.sumo_networks.conditions import TRAIN
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.networks.catalog import load_network
from dohyo.sumo_networks.routes.routing import plan_route
from dohyo.sumo_networks.scenario import Mission, Place, Scenario, Traffic

TOWN: Final = "town-train"
"""The town of NoCrash in which the thesis trains; `town-test` is never trained on."""
ROUTES_M: Final = (80.0, 250.0)
VEHICLES: Final = (0, 10, 20, 60)
WARM_UP_S: Final = 10.0
TIME_LIMIT_S: Final = 60.0
ATTEMPTS: Final = 1000
LANE_M, END_M = 40.0, 12.0
"""Shortest lane of a start or goal, and their distance from its ends."""


def draw_mission(seed: int) -> Scenario:
    """The scenario of an episode, in clear conditions.

    Raises:
        InvalidInputError: No route was found in many draws.
    """
    rng = np.random.default_rng([zlib.crc32(b"griad"), seed])
    for _ in range(ATTEMPTS):
        mission = Mission(start=_anywhere(rng), goal=_anywhere(rng))
        try:
            route = plan_route(load_network(TOWN), mission)
        except InvalidInputError:
            continue
        if ROUTES_M[0] <= route.length <= ROUTES_M[1]:
            vehicles = int(rng.choice(VEHICLES))
            traffic = Traffic(vehicles=vehicles, pedestrians=vehicles, warm_up_s=WARM_UP_S if vehicles else 0.0)
            return Scenario(
                name=f"griad-{seed}", network=TOWN, missions=(mission,), traffic=traffic, time_limit_s=TIME_LIMIT_S,
                seed=seed,
            )  # fmt: skip
    raise InvalidInputError(f"no mission of {ROUTES_M} m with seed {seed} in {ATTEMPTS} draws")


def draw_varied(seed: int) -> Scenario:
    """The scenario of `draw_mission` under that of NoCrash's four conditions of training whose turn it is.

    Raises:
        InvalidInputError: See `draw_mission`.
    """
    return draw_mission(seed).model_copy(update={"conditions": tuple(TRAIN)[seed % len(TRAIN)]})


def _anywhere(rng: np.random.Generator) -> Place:
    lanes = load_network(TOWN).lanes
    lane = int(rng.choice(lanes.longer_than(LANE_M)))
    return Place(lane=str(lanes.ids[lane]), position_m=round(float(rng.uniform(END_M, lanes.length[lane] - END_M)), 1))
