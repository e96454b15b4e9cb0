"""The freeway: 11.4 km of heavy traffic, with commands to connected vehicles and speed measurements."""

from __future__ import annotations

from dohyo.sumo_networks.freeway.process import TICK_S
from dohyo.sumo_networks.freeway.road import FreewayRoad, load_freeway
from dohyo.sumo_networks.freeway.scenario import Day, FreewayScenario, Incident, draw_day
from dohyo.sumo_networks.freeway.simulation import FreewaySimulation
from dohyo.sumo_networks.freeway.world import FreewayWorld

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
