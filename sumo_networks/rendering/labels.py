"""Labels: classes of the pixels of a semantic image."""

from __future__ import annotations

from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from dohyo.sumo_networks.rendering.surfaces import Surface
from dohyo.sumo_networks.world import ActorKind, LightState


class Label(IntEnum):
    """Class of a pixel. The four classes of traffic lights are LIGHT_OFF plus `world.LightState`."""

    NONE = 0
    TERRAIN = 1
    ROAD = 2
    MARKING = 3
    CROSSING = 4
    SIDEWALK = 5
    CYCLEWAY = 6
    BUILDING = 7
    POLE = 8
    STOP_SIGN = 9
    VEHICLE = 10
    EMERGENCY = 11
    BICYCLE = 12
    PEDESTRIAN = 13
    OBSTACLE = 14
    LIGHT_OFF = 15
    LIGHT_RED = 15 + LightState.RED
    LIGHT_YELLOW = 15 + LightState.YELLOW
    LIGHT_GREEN = 15 + LightState.GREEN


OF_SURFACE: NDArray[np.uint8] = np.zeros(len(Surface), dtype=np.uint8)
for _surface, _label in {
    Surface.TERRAIN: Label.TERRAIN,
    Surface.ROAD: Label.ROAD,
    Surface.LINE: Label.MARKING,
    Surface.STOP_LINE: Label.MARKING,
    Surface.CROSSING: Label.CROSSING,
    Surface.STRIPE: Label.CROSSING,
    Surface.SIDEWALK: Label.SIDEWALK,
    Surface.KERB: Label.SIDEWALK,
    Surface.CYCLEWAY: Label.CYCLEWAY,
    Surface.TRACK: Label.TERRAIN,
}.items():
    OF_SURFACE[_surface] = _label

OF_KIND: NDArray[np.uint8] = np.full(len(ActorKind), Label.VEHICLE, dtype=np.uint8)
OF_KIND[ActorKind.BICYCLE] = Label.BICYCLE
OF_KIND[ActorKind.EMERGENCY] = Label.EMERGENCY
OF_KIND[ActorKind.PEDESTRIAN] = Label.PEDESTRIAN
OF_KIND[ActorKind.STATIC] = Label.OBSTACLE
