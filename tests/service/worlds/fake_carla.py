"""A stand-in for the parts of CARLA's Python API that examples/carla_bridge.py uses, as its documentation has them.

Vehicles with physics keep their acceleration along their heading; all others stay where they were put.
"""

from __future__ import annotations

import fnmatch
import math
from dataclasses import dataclass, field
from typing import Any


@dataclass
class Location:
    x: float = 0.0
    y: float = 0.0
    z: float = 0.0


Vector3D = Location


@dataclass
class Rotation:
    pitch: float = 0.0
    yaw: float = 0.0
    roll: float = 0.0


@dataclass
class Transform:
    location: Location = field(default_factory=Location)
    rotation: Rotation = field(default_factory=Rotation)


@dataclass
class BoundingBox:
    location: Location = field(default_factory=Location)
    extent: Vector3D = field(default_factory=lambda: Location(2.25, 0.9, 0.8))


@dataclass
class WorldSettings:
    synchronous_mode: bool = False
    fixed_delta_seconds: float | None = None


class ActorBlueprint:
    def __init__(self, identifier: str) -> None:
        self.id, self.attributes = identifier, {} if identifier.startswith("walker.") else {"role_name": "autopilot"}

    def has_attribute(self, name: str) -> bool:
        return name in self.attributes

    def set_attribute(self, name: str, value: str) -> None:
        self.attributes[name] = value


class Actor:
    def __init__(self, world: World, identifier: int, blueprint: ActorBlueprint, transform: Transform) -> None:
        self.id, self.type_id, self.attributes = identifier, blueprint.id, dict(blueprint.attributes)
        self.bounding_box = BoundingBox()
        self.speed = self.acceleration = 0.0
        self.places = [transform]
        self._world = world

    def get_transform(self) -> Transform:
        return self.places[-1]

    def get_velocity(self) -> Vector3D:
        yaw = math.radians(self.places[-1].rotation.yaw)
        return Location(self.speed * math.cos(yaw), self.speed * math.sin(yaw))

    def set_transform(self, transform: Transform) -> None:
        self.places.append(transform)

    def set_simulate_physics(self, enabled: bool) -> None:
        assert not enabled

    def destroy(self) -> bool:
        self._world.actors.remove(self)
        return True

    def move(self, seconds: float) -> None:
        before, place = self.speed, self.places[-1]
        self.speed += self.acceleration * seconds
        metres, yaw = 0.5 * (before + self.speed) * seconds, math.radians(place.rotation.yaw)
        location = Location(place.location.x + metres * math.cos(yaw), place.location.y + metres * math.sin(yaw))
        self.places.append(Transform(location, place.rotation))


class ActorList(list[Actor]):
    def filter(self, pattern: str) -> ActorList:
        return ActorList(one for one in self if fnmatch.fnmatch(one.type_id, pattern))


class World:
    """A flat world, whose ground is 0.3 m high."""

    def __init__(self) -> None:
        self.actors: list[Actor] = []
        self.settings, self.ticks = WorldSettings(), 0

    def get_settings(self) -> WorldSettings:
        return WorldSettings(**vars(self.settings))

    def apply_settings(self, settings: WorldSettings) -> int:
        self.settings = settings
        return self.ticks

    def get_map(self) -> World:
        return self

    def get_waypoint(self, location: Location) -> Any:
        @dataclass
        class Waypoint:
            transform: Transform

        return Waypoint(Transform(Location(location.x, location.y, 0.3)))

    def get_blueprint_library(self) -> World:
        return self

    def find(self, identifier: str) -> ActorBlueprint:
        return ActorBlueprint(identifier)

    def get_actors(self) -> ActorList:
        return ActorList(self.actors)

    def try_spawn_actor(self, blueprint: ActorBlueprint, transform: Transform) -> Actor | None:
        self.actors.append(Actor(self, 100 + len(self.actors), blueprint, transform))
        return self.actors[-1]

    def tick(self) -> int:
        assert self.settings.synchronous_mode
        for actor in self.actors:
            if actor.acceleration:
                actor.move(self.settings.fixed_delta_seconds or 0.0)
        self.ticks += 1
        return self.ticks


class Client:
    def __init__(self) -> None:
        self.world = World()

    def get_world(self) -> World:
        return self.world
