"""Parking: a kart with a radar in a lot, in numba, without SUMO."""

from __future__ import annotations

from dohyo.sumo_networks.parking.env import ParkingEnv
from dohyo.sumo_networks.parking.generate import Scene
from dohyo.sumo_networks.parking.lot import Lot
from dohyo.sumo_networks.parking.rules import ALIGNED, JUDGED, SIMPLE, Outcome, Rules
from dohyo.sumo_networks.parking.vector_env import Level, ParkingVectorEnv
from dohyo.sumo_networks.parking.world import ParkingWorld, Results

__all__ = [
    "ALIGNED",
    "JUDGED",
    "SIMPLE",
    "Level",
    "Lot",
    "Outcome",
    "ParkingEnv",
    "ParkingVectorEnv",
    "ParkingWorld",
    "Results",
    "Rules",
    "Scene",
]
