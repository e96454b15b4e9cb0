"""The freeway: 11.4 km of heavy traffic, in which connected vehicles may be commanded and speeds are measured."""

from __future__ import annotations

from sumo_networks.freeway.process import TICK_S
from sumo_networks.freeway.road import FreewayRoad, load_freeway
from sumo_networks.freeway.scenario import Day, FreewayScenario, Incident, draw_day
from sumo_networks.freeway.simulation import FreewaySimulation
from sumo_networks.freeway.world import FreewayWorld

__all__ = [
    "TICK_S",
    "Day",
    "FreewayRoad",
    "FreewayScenario",
    "FreewaySimulation",
    "FreewayWorld",
    "Incident",
    "draw_day",
    "load_freeway",
]
