"""The simulation of one scenario: the only package that imports libsumo."""

from __future__ import annotations

from dohyo.sumo_networks.simulation.process import sumo_version
from dohyo.sumo_networks.simulation.replay import Replay
from dohyo.sumo_networks.simulation.simulation import START_CLEARANCE_M, Simulation

__all__ = ["START_CLEARANCE_M", "Replay", "Simulation", "sumo_version"]
