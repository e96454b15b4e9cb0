"""Camera: a flat-shaded rendering of the view of a camera on the ego, without photorealism.

The ground is read from tiles; everything else is boxes and faces, projected with a depth test per pixel, so that
occlusion is exact. Neither the route nor any other knowledge of the scenario is in the picture.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Annotated, Any, Literal

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import NDArray
from pydantic import Field

from dohyo.sumo_networks.arrays import FloatArray, IntArray
from dohyo.sumo_networks.conditions import Conditions
from dohyo.sumo_networks.networks.network import RoadNetwork
from dohyo.sumo_networks.rendering.atmosphere import FACADES, GROUND_COLOURS
from dohyo.sumo_networks.rendering.bodies import HEIGHT_M, PAINTS, PARTS, PARTS_START, own_colours
from dohyo.sumo_networks.rendering.buildings import buildings_near
from dohyo.sumo_networks.rendering.develop import add_rain, develop_colours, develop_depth, develop_labels
from dohyo.sumo_networks.rendering.fixtures import fixtures_of
from dohyo.sumo_networks.rendering.ground import ground_colours, ground_labels
from dohyo.sumo_networks.rendering.labels import OF_KIND, OF_SURFACE, Label
from dohyo.sumo_networks.rendering.perspective import Canvas, Haze
from dohyo.sumo_networks.rendering.scene import (
    Bodies,
    Models,
    draw_bodies,
    draw_buildings,
    draw_fixtures,
    draw_shadows,
)
from dohyo.sumo_networks.rendering.tiles import Tiles, TileWindow, colour_tiles
from dohyo.sumo_networks.rendering.view import CameraView, Optics, view_of
from dohyo.sumo_networks.sensors.base import Sensor, SensorConfig, Track
from dohyo.sumo_networks.units import SIGHT_M
from dohyo.sumo_networks.world import ActorKind, World

FAR_M = 1000.0
GRAIN = 1 << 16
MOVED_M = 8.0
LARGEST_BUILDING_M = 25.0
SUN_ASIDE_RAD = 0.9
SUN_HEIGHT_RAD = 0.75

Side = Annotated[int, Field(ge=8, le=2048)]

_MODELS = Models(OF_KIND, PARTS, PARTS_START, PAINTS)


class CameraConfig(SensorConfig):
    """Configuration of a camera: mode, picture and mounting.

    Attributes:
        name: Key in the observation.
        mode: "rgb", "semantic" (classes of `rendering.labels.Label`) or "depth".
        width: Width of the picture, px.
        height: Height of the picture, px.
        fov_deg: Horizontal angle of view, degrees; pixels are square.
        x_m: Distance of the mounting ahead of the centre of the ego's box, m.
        y_m: Distance of the mounting to the left of the centre, m.
        z_m: Height of the mounting above the road, m.
        yaw_deg: Yaw to the left, degrees.
        pitch_deg: Pitch upwards, degrees.
        roll_deg: Roll clockwise, seen from behind, degrees.
    """

    mode: Literal["rgb", "semantic", "depth"] = "rgb"
    width: Side = 256
    height: Side = 256
    fov_deg: Annotated[float, Field(ge=10, le=150)] = 90.0
    x_m: Annotated[float, Field(ge=-10, le=10)] = 1.3
    y_m: Annotated[float, Field(ge=-10, le=10)] = 0.0
    z_m: Annotated[float, Field(gt=0.2, le=20)] = 1.8
    yaw_deg: Annotated[float, Field(ge=-180, le=180)] = 0.0
    pitch_deg: Annotated[float, Field(ge=-80, le=80)] = 0.0
    roll_deg: Annotated[float, Field(ge=-180, le=180)] = 0.0

    @property
    def optics(self) -> Optics:
        """Picture and mounting, without the mode."""
        return Optics(**{field.name: getattr(self, field.name) for field in dataclasses.fields(Optics)})

    @property
    def track(self) -> Track:
        """Track of sensors that a car can carry."""
        return Track.SENSORS

    @property
    def space(self) -> Box:
        """Box of the array, channels first."""
        if self.mode == "depth":
            return Box(0.0, FAR_M, (1, self.height, self.width), np.float32)
        if self.mode == "semantic":
            return Box(0, max(Label), (1, self.height, self.width), np.uint8)
        return Box(0, 255, (3, self.height, self.width), np.uint8)

    def make(self, conditions: Conditions, rng: np.random.Generator) -> Camera:
        """Makes the sensor; see `SensorConfig`."""
        return Camera(self, conditions, rng)


class Camera(Sensor):
    """(3, H, W) uint8 colours; or (1, H, W) uint8 labels; or (1, H, W) float32 depth along the axis, m.

    Row 0 is the top. Depth is 1000 and the label 0 if nothing is within the conditions' visibility or within 100 m,
    the range of the world. Pictures are uint8, as image encoders and replay buffers expect.
    """

    track = Track.SENSORS

    def __init__(self, config: CameraConfig, conditions: Conditions, rng: np.random.Generator) -> None:
        self.config, self.name, self.space = config, config.name, config.space
        # A generator of its own, since recordings make several cameras from one.
        self._view, self._rng = view_of(config.optics, conditions), rng.spawn(1)[0]
        air = self._view.air
        self._tint, self._horizon = air.tint.astype(np.float32), air.horizon.astype(np.float32)
        noise = self._rng.standard_normal(GRAIN) * air.noise if air.noise > 0.0 else np.empty(0)
        self._grain = np.clip(np.rint(noise), -100, 100).astype(np.int8)
        self._streaks = round(air.rain * config.width * config.height / 1000)
        self._value = np.zeros((config.height, config.width), dtype=np.uint32)
        self._inverse = np.zeros((config.height, config.width), dtype=np.float32)
        self._scratch = np.zeros((8, 16, 3))
        self._tables: list[tuple[tuple[int, ...], IntArray, int, int]] = []
        self._around: _Surroundings | None = None

    def read(self, world: World, ego: int) -> NDArray[Any]:
        """Reads the array; see the class."""
        config, view = self.config, self._view
        place = np.array([*world.egos.position[ego], world.egos.heading[ego]])
        if self._around is None or not self._around.holds(world.network, place):
            self._around = _Surroundings(world.network, place)
            self._tables = [((), np.empty((0, 0), dtype=np.int64), 0, 0)] * len(view.levels)
        self._inverse[:] = view.inverse
        if config.mode == "semantic":
            self._value[:] = 0
        self._draw_ground(world.network, place)
        self._draw_all(world, ego, place)
        return self._develop()

    def _draw_ground(self, network: RoadNetwork, place: FloatArray) -> None:
        view, flat = self._view, self._value.reshape(-1)
        if self.config.mode == "depth":
            return
        if self.config.mode == "rgb":
            self._value[:] = view.sky
        for number, level in enumerate(view.levels):
            tiles = colour_tiles(network, level.metres_per_px, GROUND_COLOURS)
            slots = self._table(number, tiles, level.corners, place)
            window = TileWindow(tiles.pool, *slots, level.metres_per_px)
            if self.config.mode == "rgb":
                sky = (self._tint, self._horizon)
                ground_colours(flat, level.pixel, level.points, level.taps, level.tone, place, *sky, window)
            else:
                ground_labels(flat, level.pixel, level.points, place, OF_SURFACE, window)

    def _table(self, number: int, tiles: Tiles, corners: FloatArray, place: FloatArray) -> tuple[IntArray, int, int]:
        """Slots of the tiles that one level needs; updated only when the tiles change."""
        cos, sin = math.cos(place[2]), math.sin(place[2])
        x = place[0] + corners[:, 0] * cos - corners[:, 1] * sin
        y = place[1] + corners[:, 0] * sin + corners[:, 1] * cos
        margin = tiles.metres_per_px
        box = (float(x.min()) - margin, float(y.min()) - margin, float(x.max()) + margin, float(y.max()) + margin)
        key = (*(math.floor(side / tiles.side_m) for side in box), tiles.generation)
        if self._tables[number][0] != key:
            table = tiles.table(*box)
            self._tables[number] = ((*key[:4], tiles.generation), *table)
        return self._tables[number][1:]

    def _draw_all(self, world: World, ego: int, place: FloatArray) -> None:
        view, coloured, scratch = self._view, self.config.mode == "rgb", self._scratch
        around = self._around
        assert around is not None
        bodies, kind, indicator, key = _bodies(world, ego)
        light, shadows = _light(view, around.sun, float(place[2]))
        reach = view.air.range_m
        heights = HEIGHT_M[kind]
        canvas = Canvas(self._value, self._inverse, place, view.mount, view.lens, light, reach, scratch)
        if coloured:
            draw_shadows(canvas, bodies, heights, shadows, view.air.sun, Haze(view.ray, view.fog, self._horizon))
        draw_bodies(canvas, Bodies(bodies, kind, indicator, own_colours(kind, key), heights), _MODELS, coloured)
        draw_fixtures(canvas, around.heads, world.signals[around.signal], around.wires, around.signs, not coloured)
        label, night = -1 if coloured else int(Label.BUILDING), 0.3 * min(view.air.lamps / 0.4, 1.0)
        draw_buildings(canvas, around.buildings, FACADES, label, night)

    def _develop(self) -> NDArray[Any]:
        view, config = self._view, self.config
        reach = view.air.range_m
        if config.mode == "depth":
            depth = np.empty((1, config.height, config.width), dtype=np.float32)
            develop_depth(self._inverse, view.ray, reach, FAR_M, depth)
            return depth
        if config.mode == "semantic":
            labels = np.empty((1, config.height, config.width), dtype=np.uint8)
            develop_labels(self._value, self._inverse, view.ray, reach, labels)
            return labels
        picture = np.empty((3, config.height, config.width), dtype=np.uint8)
        shift = int(self._rng.integers(GRAIN)) if len(self._grain) else 0
        develop_colours(
            self._value,
            self._inverse,
            view.sky,
            view.ray,
            view.fog,
            self._tint,
            self._horizon,
            reach,
            self._grain,
            shift,
            picture,
        )
        if self._streaks:
            add_rain(picture, self._rng.random((self._streaks, 3)), self._horizon)
        return picture


class _Surroundings:
    """Buildings and fixtures around a place; valid until the ego has moved by 8 m."""

    def __init__(self, network: RoadNetwork, place: FloatArray) -> None:
        self._network, self._x, self._y = network, float(place[0]), float(place[1])
        fixtures, reach = fixtures_of(network), SIGHT_M + MOVED_M
        box = (self._x - reach, self._y - reach, self._x + reach, self._y + reach)
        near = fixtures.head_cells.near(*box)
        self.heads, self.signal = fixtures.heads[near], fixtures.signal[near]
        self.wires = fixtures.wires[fixtures.wire_cells.near(*box, 15.0)]
        self.signs = fixtures.signs[fixtures.sign_cells.near(*box)]
        buildings = buildings_near(network, self._x, self._y, reach + LARGEST_BUILDING_M)
        distance = np.hypot(buildings[:, 0] - self._x, buildings[:, 1] - self._y)
        # Nearest first, so that most hidden pixels cost one comparison only.
        order = np.argsort(distance, kind="stable")
        self.buildings = buildings[order[distance[order] < reach + LARGEST_BUILDING_M]]
        first = int(np.flatnonzero(network.lanes.drivable)[0])
        (x0, y0), (x1, y1) = network.lane_shape(first)[:2]
        # The sun's direction is that of the network's first road, so that it turns with a rotated network.
        self.sun = math.atan2(y1 - y0, x1 - x0) + SUN_ASIDE_RAD

    def holds(self, network: RoadNetwork, place: FloatArray) -> bool:
        """Whether everything visible from a place is included."""
        return self._network is network and math.hypot(place[0] - self._x, place[1] - self._y) < MOVED_M


def _bodies(world: World, ego: int) -> tuple[FloatArray, IntArray, IntArray, IntArray]:
    """Boxes, kinds, indicators and keys of all actors and of the other egos."""
    actors, egos = world.actors, world.egos
    bodies, kind, indicator, key = actors.boxes(), actors.kind, actors.indicator, actors.key
    if len(egos.names) > 1:
        others = np.flatnonzero(egos.active & (np.arange(len(egos.names)) != ego))
        boxes = [egos.box(other) for other in others.tolist()]
        bodies = np.concatenate([bodies, np.array(boxes).reshape(-1, 5)])
        kind = np.concatenate([kind, np.full(len(others), int(ActorKind.EGO))])
        indicator = np.concatenate([indicator, np.zeros(len(others), dtype=np.int64)])
        key = np.concatenate([key, 10_000_000 + others])
    return bodies, kind, indicator, key


def _light(view: CameraView, sun: float, heading: float) -> tuple[FloatArray, FloatArray]:
    """(8,) light as in `perspective.Canvas`, and (2,) vector of shadows per metre of height, m, network frame."""
    level, height = math.cos(SUN_HEIGHT_RAD), math.sin(SUN_HEIGHT_RAD)
    direction = np.array([level * math.cos(sun - heading), level * math.sin(sun - heading), height])
    up = view.mount[1:, 2]
    light = np.array([*(view.mount[1:] @ direction), view.air.sun, *up, 0.0])
    return light, -np.array([math.cos(sun), math.sin(sun)]) * level / height
