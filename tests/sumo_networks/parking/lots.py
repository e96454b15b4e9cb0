"""Hand-made lots, and karts that drive in them."""

from __future__ import annotations

import math

import numpy as np

from dohyo.sumo_networks.parking import kart
from dohyo.sumo_networks.parking.lot import Lot, Pose, Spot
from dohyo.sumo_networks.parking.rules import JUDGED, Rules
from dohyo.sumo_networks.parking.tables import OUTCOME
from dohyo.sumo_networks.parking.world import ParkingWorld

REST = np.array([0.0, 0.0, 1.0])
"""Brake."""
SPOT = Spot(x_m=0.0, y_m=0.0, heading_rad=math.pi / 2, length_m=5.0, width_m=2.5)


def lot_of(*karts: Pose, **rest) -> Lot:
    """A lot with one free spot in the origin that faces north, unless `spots` says otherwise."""
    return Lot(**{"spots": (SPOT,), **rest}, karts=karts)


def world_of(lot: Lot, rules: Rules = JUDGED) -> ParkingWorld:
    """A world with one lot."""
    world = ParkingWorld(1, len(lot.karts))
    world.place(0, lot, rules)
    return world


def moving(world: ParkingWorld, speed_mps: float, number: int = 0) -> ParkingWorld:
    """The world with a kart that moves already."""
    world.view(0).karts[number, kart.SPEED] = speed_mps
    return world


def drive(world: ParkingWorld, action: np.ndarray = REST, ticks: int = 600) -> ParkingWorld:
    """Drives until every episode has ended, at most for some ticks."""
    for _ in range(ticks):
        if not world.running.any():
            break
        world.step(np.broadcast_to(action, (1, world.karts, 3)))
    return world


def outcome(world: ParkingWorld, number: int = 0) -> int:
    """Outcome of a kart."""
    return int(world.view(0).counts[number, OUTCOME])
