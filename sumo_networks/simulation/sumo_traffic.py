"""SUMO's own traffic: queries, and the commands that carry out requests."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache

import libsumo
import numpy as np

from dohyo.sumo_networks.actors.names import TRAFFIC, Role, is_approaching, role_of
from dohyo.sumo_networks.actors.requests import SpawnPedestrian, SpawnVehicle, Walk
from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.networks.network import RoadNetwork
from dohyo.sumo_networks.routes.approaches import NEIGHBOURHOOD_M, Approach
from dohyo.sumo_networks.simulation.sumo_frame import vehicle_box

_AHEAD_M = 1.0

# Queries.


def is_free(network: RoadNetwork, place: Approach, proxy: str) -> bool:
    """Whether no vehicle of the route's lanes is beside a place or less than 20 m behind it, and would brake there."""
    cos, sin = math.cos(place.direction), math.sin(place.direction)
    for lane in place.lanes:
        for name in libsumo.lane.getLastStepVehicleIDs(str(network.lanes.ids[lane])):
            if name != proxy:
                front_x, front_y = libsumo.vehicle.getPosition(name)
                ahead = (front_x - place.x) * cos + (front_y - place.y) * sin
                if -NEIGHBOURHOOD_M < ahead < _AHEAD_M + libsumo.vehicle.getLength(name):
                    return False
    return True


def arrived() -> tuple[Sequence[str], Sequence[str]]:
    """Names of the vehicles and of the pedestrians that reached their goal in the last step, or were removed since."""
    return libsumo.simulation.getArrivedIDList(), libsumo.simulation.getArrivedPersonIDList()


def departed() -> Sequence[str]:
    """Names of the vehicles that entered the road in the last step."""
    names: Sequence[str] = libsumo.simulation.getDepartedIDList()
    return names


def way_on_foot(walk: Walk) -> tuple[str, ...]:
    """SUMO edge ids of the path of a walk; empty if there is none."""
    stages = libsumo.simulation.findIntermodalRoute(
        walk.source, walk.target, departPos=walk.source_m, arrivalPos=walk.target_m
    )
    return tuple(stages[0].edges) if len(stages) == 1 else ()


@lru_cache(maxsize=48)
def closed_to(network: RoadNetwork, kind: str) -> frozenset[int]:
    """Lanes of a network that are open to cars and closed to a type of vehicle; SUMO must run on that network.

    Args:
        network: The road network.
        kind: Name of a vType in vehicle_types.add.xml.
    """
    own_class = libsumo.vehicletype.getVehicleClass(kind)
    lanes = network.lanes
    return frozenset(
        lane
        for lane in np.flatnonzero(lanes.drivable).tolist()
        if own_class in libsumo.lane.getDisallowed(str(lanes.ids[lane]))
    )


def vehicles_near(x: float, y: float, radius_m: float) -> FloatArray:
    """(M, 6) x, y [m], heading [rad], length, width [m], speed [m/s] of vehicles near a point.

    Egos and actors of events are included; the proxies of jaywalkers and of approaching egos are excluded.
    """
    rows = [
        (*vehicle_box(name), libsumo.vehicle.getSpeed(name))
        for name in libsumo.vehicle.getIDList()
        if math.dist(libsumo.vehicle.getPosition(name), (x, y)) <= radius_m
        and role_of(name) is not Role.JAYWALKER
        and not is_approaching(name)
    ]
    return np.array(rows, dtype=np.float64).reshape(-1, 6)


# Commands.


def spawn_vehicle(request: SpawnVehicle) -> None:
    """Lets a vehicle enter as soon as there is room."""
    name = request.name
    libsumo.route.add(name, request.edges)
    # SUMO raises an error for a speed in numbers that is too fast for a light ahead.
    libsumo.vehicle.add(name, name, request.type, "now", request.lane, request.position, request.speed)
    if request.max_speed_mps is not None:
        libsumo.vehicle.setMaxSpeed(name, request.max_speed_mps)


def spawn_pedestrian(request: SpawnPedestrian) -> None:
    """Lets a pedestrian enter."""
    walk = request.walk
    libsumo.person.add(request.name, walk.source, walk.source_m, typeID="pedestrian")
    libsumo.person.appendWalkingStage(request.name, request.edges, walk.target_m)


def cancel_vehicle(name: str) -> None:
    """Removes a vehicle that still waits for room."""
    if name in libsumo.simulation.getPendingVehicles():
        libsumo.vehicle.remove(name)


def remove_traffic_near(x: float, y: float, radius_m: float) -> None:
    """Removes the traffic's vehicles whose front is near a point; until its next step SUMO lists them as arrived."""
    for name in libsumo.vehicle.getIDList():
        if role_of(name) in TRAFFIC and math.dist(libsumo.vehicle.getPosition(name), (x, y)) < radius_m:
            libsumo.vehicle.remove(name)
