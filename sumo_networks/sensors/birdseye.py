"""Bird's-eye view: the surroundings from above, the ego upwards, as masks or as a picture.

Layers and their order are PRIBOOT's (Coelho 2024); sizes are parameters.
"""

from __future__ import annotations

import math
from enum import IntEnum
from functools import lru_cache
from typing import Annotated, Literal

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import NDArray
from pydantic import Field

from dohyo.sumo_networks.arrays import FloatArray, IntArray
from dohyo.sumo_networks.conditions import Conditions
from dohyo.sumo_networks.networks.network import RoadNetwork
from dohyo.sumo_networks.rendering.plan import (
    draw_arrows,
    draw_boxes,
    draw_discs,
    draw_path,
    to_colours,
    to_masks,
    warp,
)
from dohyo.sumo_networks.rendering.surfaces import CellIndex, Surface
from dohyo.sumo_networks.rendering.tiles import CAPACITY, TILE_PX, TileWindow, surface_tiles
from dohyo.sumo_networks.sensors.base import Sensor, SensorConfig, Track
from dohyo.sumo_networks.world import ActorKind, LightState, World

SIGN_RADIUS_M = 1.2
TEXELS_PER_PX = 2


class Layer(IntEnum):
    """Layer of a mask, bottom first: where layers overlap, the picture shows the last one."""

    ROAD = 0
    ROUTE = 1
    LINES = 2
    VEHICLES = 3
    EMERGENCY = 4
    BICYCLES = 5
    EGO = 6
    GREEN_LIGHTS = 7
    YELLOW_LIGHTS = 8
    RED_LIGHTS = 9
    PEDESTRIANS = 10
    STOP_SIGNS = 11
    CONSTRUCTION = 12
    ARROWS = 13


BACKGROUND = (24, 27, 32)
COLOURS: dict[Layer, tuple[int, int, int]] = {
    Layer.ROAD: (74, 79, 88),
    Layer.ROUTE: (108, 92, 160),
    Layer.LINES: (214, 214, 206),
    Layer.VEHICLES: (70, 150, 226),
    Layer.EMERGENCY: (240, 120, 196),
    Layer.BICYCLES: (66, 204, 204),
    Layer.EGO: (255, 255, 255),
    Layer.GREEN_LIGHTS: (50, 210, 110),
    Layer.YELLOW_LIGHTS: (250, 210, 60),
    Layer.RED_LIGHTS: (236, 56, 48),
    Layer.PEDESTRIANS: (255, 176, 64),
    Layer.STOP_SIGNS: (176, 24, 90),
    Layer.CONSTRUCTION: (206, 130, 92),
    Layer.ARROWS: (255, 244, 150),
}


class BirdseyeConfig(SensorConfig):
    """Configuration of a view from above.

    Attributes:
        name: Key in the observation.
        mode: "masks", one per Layer, or "rgb".
        width: Width of the view, px.
        height: Height of the view, px.
        metres_per_px: Size of a pixel, m.
        ahead_m: Distance from the ego's centre to the top edge, m.
        left_m: Distance from the ego's centre to the left edge, m; by default half the width.
        route_m: Length of the route that is drawn, m.
        route_width_m: Width of the route's line, m.
        pedestrian_scale: Factor on the size of people, so that they are visible.
        arrow_s: Time in which an actor moves the length of its arrow, s.
    """

    mode: Literal["masks", "rgb"] = "masks"
    width: Annotated[int, Field(ge=8, le=2048)] = 192
    height: Annotated[int, Field(ge=8, le=2048)] = 192
    metres_per_px: Annotated[float, Field(ge=0.05, le=2.0)] = 0.25
    ahead_m: Annotated[float, Field(ge=-500, le=500)] = 36.0
    left_m: Annotated[float, Field(ge=-500, le=500)] | None = None
    route_m: Annotated[float, Field(ge=0, le=1000)] = 150.0
    route_width_m: Annotated[float, Field(gt=0, le=20)] = 3.0
    pedestrian_scale: Annotated[float, Field(gt=0, le=10)] = 3.0
    arrow_s: Annotated[float, Field(ge=0, le=5)] = 0.5

    @property
    def track(self) -> Track:
        """Privileged, since the view shows the route and the exact places of others."""
        return Track.PRIVILEGED

    @property
    def space(self) -> Box:
        """Box of the array, channels first."""
        channels = len(Layer) if self.mode == "masks" else 3
        return Box(0, 255, (channels, self.height, self.width), np.uint8)

    def make(self, conditions: Conditions, rng: np.random.Generator) -> Birdseye:
        """Makes the sensor; see `SensorConfig`."""
        return Birdseye(self)


class Birdseye(Sensor):
    """(14, H, W) uint8 a mask per Layer, 0 or 255; or (3, H, W) uint8 colours.

    Row 0 is farthest ahead, column 0 farthest left. A light is a disc on its stop line: the route's own signal on the
    route, elsewhere the most permissive of the lane's signals. The arrows of bicycles and cars grow with their speed.
    """

    track = Track.PRIVILEGED

    def __init__(self, config: BirdseyeConfig) -> None:
        self.config, self.name, self.space = config, config.name, config.space
        left = config.left_m if config.left_m is not None else config.width * config.metres_per_px / 2
        self._view = np.array([config.metres_per_px, config.ahead_m, left])
        self._bits = np.zeros((config.height, config.width), dtype=np.uint16)
        x, y = (
            np.array([config.ahead_m, config.ahead_m - config.height * config.metres_per_px]),
            np.array([left, left - config.width * config.metres_per_px]),
        )
        self._corners = np.array([(a, b) for a in x for b in y])
        # Enough tiles for a view at any angle.
        side = math.hypot(config.width, config.height) * TEXELS_PER_PX / TILE_PX + 2.0
        self._capacity = max(CAPACITY, math.ceil(side) ** 2)
        self._key: tuple[object, ...] = ()
        self._table: tuple[IntArray, int, int] = (np.empty((0, 0), dtype=np.int64), 0, 0)

    def read(self, world: World, ego: int) -> NDArray[np.uint8]:
        """Reads the array; see the class."""
        config = self.config
        place = np.array([*world.egos.position[ego], world.egos.heading[ego]])
        box = self._draw_ground(world.network, place)
        self._draw_route(world, ego, place)
        self._draw_actors(world, ego, place)
        self._draw_stop_lines(world, ego, place, box)
        out = np.empty(self.space.shape, dtype=np.uint8)
        if config.mode == "masks":
            to_masks(self._bits, out)
        else:
            to_colours(self._bits, palette(), out)
        return out

    def _draw_ground(self, network: RoadNetwork, place: FloatArray) -> tuple[float, float, float, float]:
        """Draws roads and lines; returns smallest x, y, largest x, y of the view, m."""
        cos, sin = math.cos(place[2]), math.sin(place[2])
        x = place[0] + self._corners @ (cos, -sin)
        y = place[1] + self._corners @ (sin, cos)
        box = (float(x.min()) - 0.1, float(y.min()) - 0.1, float(x.max()) + 0.1, float(y.max()) + 0.1)
        tiles = surface_tiles(network, self.config.metres_per_px / TEXELS_PER_PX, self._capacity)
        wanted = tuple(math.floor(side / tiles.side_m) for side in box)
        if self._key != (network, wanted, tiles.generation):
            self._table = tiles.table(*box)
            self._key = (network, wanted, tiles.generation)
        warp(self._bits, self._view, place, _OF_SURFACE, TileWindow(tiles.pool, *self._table, tiles.metres_per_px))
        return box

    def _draw_route(self, world: World, ego: int, place: FloatArray) -> None:
        route = world.routes[ego]
        first = route.index(float(world.egos.progress[ego]))
        points = route.position[first : first + int(self.config.route_m) + 1]
        draw_path(self._bits, points, self.config.route_width_m, 1 << Layer.ROUTE, self._view, place)

    def _draw_actors(self, world: World, ego: int, place: FloatArray) -> None:
        actors, egos, view = world.actors, world.egos, self._view
        boxes, kind, speed = actors.boxes(), actors.kind, actors.speed
        boxes[kind == ActorKind.PEDESTRIAN, 3:] *= self.config.pedestrian_scale
        layer = _OF_KIND[kind]
        others = egos.active & (np.arange(len(egos.names)) != ego)
        if others.any():
            rows = np.flatnonzero(others)
            boxes = np.concatenate([boxes, [egos.box(int(row)) for row in rows]])
            layer = np.concatenate([layer, np.full(len(rows), 1 << Layer.VEHICLES)])
            speed = np.concatenate([speed, egos.speed[rows]])
        draw_boxes(self._bits, boxes, layer, view, place)
        draw_boxes(self._bits, egos.box(ego)[None], np.array([1 << Layer.EGO]), view, place)
        draw_arrows(self._bits, boxes, speed, self.config.arrow_s, 1 << Layer.ARROWS, view, place)

    def _draw_stop_lines(
        self, world: World, ego: int, place: FloatArray, box: tuple[float, float, float, float]
    ) -> None:
        lines, centres, cells = _stop_lines(world.network)
        near = cells.near(*box, SIGN_RADIUS_M)
        if not len(near):
            return
        rows = lines[near]
        layer = _light_layers(world, ego, rows)
        layer[world.network.stop_lines.stop_sign[rows] & (layer == 0)] = 1 << Layer.STOP_SIGNS
        draw_discs(self._bits, centres[near], SIGN_RADIUS_M, layer, self._view, place)


def _light_layers(world: World, ego: int, rows: IntArray) -> IntArray:
    """(N,) bit of the light at each stop line, 0 if there is none or it is off."""
    network = world.network
    connections = network.connections
    own = {passage.connection for passage in world.routes[ego].passages if passage.signal >= 0}
    out = np.zeros(len(rows), dtype=np.int64)
    for number, row in enumerate(rows.tolist()):
        if not network.stop_lines.lit[row]:
            continue
        ways = network.connections_from(int(network.stop_lines.lane[row]))
        chosen = [c for c in ways if c in own] or [c for c in ways if connections.signal[c] >= 0]
        state = max((int(world.signals[connections.signal[c]]) for c in chosen), default=int(LightState.OFF))
        out[number] = _OF_LIGHT[state]
    return out


@lru_cache(maxsize=4)
def _stop_lines(network: RoadNetwork) -> tuple[IntArray, FloatArray, CellIndex]:
    """Rows of the stop lines and their middles, sorted by cell."""
    segment = network.stop_lines.segment
    centres = (segment[:, :2] + segment[:, 2:]) / 2
    cells = CellIndex(centres)
    return cells.order, centres[cells.order], cells


@lru_cache(maxsize=1)
def palette() -> NDArray[np.uint8]:
    """(2 ** 14, 3) colour of the last layer of every set of layers."""
    bits = np.arange(1 << len(Layer))
    out = np.empty((len(bits), 3), dtype=np.uint8)
    out[:] = BACKGROUND
    for layer in Layer:
        out[(bits >> layer) & 1 == 1] = COLOURS[layer]
    return out


_ROADS = (Surface.ROAD, Surface.CROSSING, Surface.STRIPE, Surface.LINE, Surface.STOP_LINE)
_OF_SURFACE: NDArray[np.uint16] = np.zeros(len(Surface), dtype=np.uint16)
_OF_SURFACE[list(_ROADS)] = 1 << Layer.ROAD
_OF_SURFACE[Surface.LINE] |= 1 << Layer.LINES

_OF_KIND: IntArray = np.full(len(ActorKind), 1 << Layer.VEHICLES, dtype=np.int64)
_OF_KIND[ActorKind.BICYCLE] = 1 << Layer.BICYCLES
_OF_KIND[ActorKind.EMERGENCY] = 1 << Layer.EMERGENCY
_OF_KIND[ActorKind.PEDESTRIAN] = 1 << Layer.PEDESTRIANS
_OF_KIND[ActorKind.STATIC] = 1 << Layer.CONSTRUCTION

_OF_LIGHT = (0, 1 << Layer.RED_LIGHTS, 1 << Layer.YELLOW_LIGHTS, 1 << Layer.GREEN_LIGHTS)
