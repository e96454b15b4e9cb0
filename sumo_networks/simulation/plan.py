"""ScenarioPlan: a scenario with its network and routes, checked before SUMO starts."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from dohyo.sumo_networks.conditions import Conditions, conditions_named
from dohyo.sumo_networks.ego.dynamics import VehicleParameters
from dohyo.sumo_networks.ego.fleet import EgoFleet
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.events.placement import check_placement
from dohyo.sumo_networks.geometry import boxes_overlap
from dohyo.sumo_networks.networks.network import RoadNetwork
from dohyo.sumo_networks.routes.route import Route
from dohyo.sumo_networks.routes.routing import plan_route
from dohyo.sumo_networks.scenario import Scenario
from dohyo.sumo_networks.simulation.traffic_log import logs_folder, read_log
from dohyo.sumo_networks.traffic.flows import make_flow_sources


@dataclass(frozen=True, slots=True)
class ScenarioPlan:
    """Everything that a simulation needs to start; one plan may start many simulations.

    Attributes:
        network: The road network.
        scenario: The scenario to simulate.
        conditions: Conditions of road, light and air.
        vehicle: Vehicle parameters of the egos under these conditions.
        routes: One route per ego.
    """

    network: RoadNetwork
    scenario: Scenario
    conditions: Conditions
    vehicle: VehicleParameters
    routes: tuple[Route, ...]

    @property
    def egos(self) -> tuple[str, ...]:
        """Names of the missions."""
        return tuple(mission.name for mission in self.scenario.missions)

    @property
    def start_speeds(self) -> list[float]:
        """Start speed of each ego, m/s."""
        return [mission.start_speed_mps or 0.0 for mission in self.scenario.missions]

    def with_seed(self, seed: int) -> ScenarioPlan:
        """The same plan with another seed of the scenario."""
        return replace(self, scenario=self.scenario.model_copy(update={"seed": seed}))

    def fleet(self) -> EgoFleet:
        """Makes the egos' vehicles at their starts."""
        return EgoFleet(self.network, self.egos, self.routes, self.vehicle, self.start_speeds)


def plan_scenario(network: RoadNetwork, scenario: Scenario, vehicle: VehicleParameters | None = None) -> ScenarioPlan:
    """Plans the routes, and checks that starts, flows, events and log are possible, without SUMO.

    Args:
        network: The road network.
        scenario: The scenario to simulate.
        vehicle: Vehicle parameters of the egos on a dry road; None: the default car.

    Raises:
        InvalidInputError: A mission, flow or event is impossible, two egos touch at their starts, or the log is
            missing, damaged, too short or of another network; the message says which and why.
    """
    conditions, dry = conditions_named(scenario.conditions), vehicle or VehicleParameters()
    routes = tuple(plan_route(network, mission) for mission in scenario.missions)
    on_road = replace(dry, friction=dry.friction * conditions.friction)
    plan = ScenarioPlan(network, scenario, conditions, on_road, routes)
    _check_starts(plan)
    if scenario.log is None:
        for event in scenario.events:
            ego = event.ego or plan.egos[0]
            check_placement(event, ego, network, routes[plan.egos.index(ego)])
        make_flow_sources(network, scenario.traffic.flows, np.random.default_rng(0))
    else:
        read_log(scenario.log, logs_folder()).check(network, scenario)
    return plan


def _check_starts(plan: ScenarioPlan) -> None:
    """Raises InvalidInputError if two egos touch at their starts."""
    fleet, size = plan.fleet(), (plan.vehicle.length, plan.vehicle.width)
    boxes = np.array([(*centre, fleet.heading(ego), *size) for ego, centre in enumerate(fleet.centres.tolist())])
    touch = boxes_overlap(boxes, boxes)
    for one, other in combinations(range(len(boxes)), 2):
        if touch[one, other]:
            start = plan.scenario.missions[other].start
            raise InvalidInputError(
                f"missions '{plan.egos[one]}' and '{plan.egos[other]}' start too near each other: their cars touch at "
                f"{start.position_m:g} m of lane '{start.lane}'"
            )
