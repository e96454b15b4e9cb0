"""Hand-made worlds: small roads, boxes that move as told, and no simulation.

    scene = straight_road().with_ego(x=50, speed=0).with_actor(x=44, speed=8, length=4.5)
    scene.worlds(seconds=2)      # one World per tick
    run(scene, seconds=2)        # what the criteria make of them

A scene is immutable; every `with_...` gives a new one. Missions start eastward, so x runs along the road and y grows to
the left; a body without a `y` is on the mission's first lane, `left` metres left of its centre. Speeds, drifts and
lights may be functions of time instead of numbers.
"""

from __future__ import annotations

import dataclasses
import hashlib
import math
import os
import subprocess
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache, cached_property
from itertools import pairwise
from pathlib import Path
from types import MappingProxyType
from typing import TypeVar

import numpy as np
import sumo

from dohyo.evaluation.criteria import Criterion
from dohyo.evaluation.episode.judge import Judge
from dohyo.evaluation.records.specifications import InfractionKind, Status
from dohyo.sumo_networks.arrays import FloatArray, IntArray
from dohyo.sumo_networks.geometry import boxes_overlap, wrap_angle
from dohyo.sumo_networks.networks.network import RoadNetwork, cache_folder, read_network
from dohyo.sumo_networks.routes.route import Route
from dohyo.sumo_networks.routes.routing import plan_route
from dohyo.sumo_networks.scenario import Mission, Place, Scenario
from dohyo.sumo_networks.units import TICK_S
from dohyo.sumo_networks.world import ActorKind, Actors, Contact, Egos, LightState, World

LANE_M = 3.2

T = TypeVar("T")
Speed = float | Callable[[float], float]
Light = LightState | Callable[[float], LightState]


@dataclass(frozen=True)
class Body:
    """A box that moves as told.

    Attributes:
        name: Unique in its scene.
        kind: ActorKind.EGO for an ego.
        x: Centre at the start, m.
        y: Centre at the start, m.
        heading: rad.
        speed: m/s along the heading; negative: it backs up.
        drift: m/s to the left of the heading.
        length: m.
        width: m.
    """

    name: str
    kind: ActorKind
    x: float
    y: float
    heading: float
    speed: Speed
    drift: Speed
    length: float
    width: float


@dataclass(frozen=True)
class Scene:
    """A network, a mission, and the boxes on it.

    Attributes:
        network: The roads.
        mission: What every ego has to do.
        bodies: Egos and actors.
        lights: State of the signals by SUMO's direction letter of their connection; "" for all others.
    """

    network: RoadNetwork
    mission: Mission
    bodies: tuple[Body, ...] = ()
    lights: Mapping[str, Light] = field(default_factory=lambda: MappingProxyType({"": LightState.GREEN}))

    def with_ego(
        self,
        x: float,
        speed: Speed = 0.0,
        *,
        y: float | None = None,
        left: float = 0.0,
        heading: float = 0.0,
        drift: Speed = 0.0,
        length: float = 4.5,
        width: float = 1.8,
    ) -> Scene:
        name = self.mission.name + str(len(self._egos) or "")
        y = self.route.position[0, 1] + left if y is None else y
        return self._with(Body(name, ActorKind.EGO, x, y, heading, speed, drift, length, width))

    def with_actor(
        self,
        x: float,
        speed: Speed = 0.0,
        *,
        kind: ActorKind = ActorKind.CAR,
        y: float | None = None,
        left: float = 0.0,
        heading: float = 0.0,
        drift: Speed = 0.0,
        length: float = 4.5,
        width: float = 1.8,
    ) -> Scene:
        name = f"actor{len(self._actors)}"
        y = self.route.position[0, 1] + left if y is None else y
        return self._with(Body(name, kind, x, y, heading, speed, drift, length, width))

    def with_pedestrian(self, x: float, speed: Speed = 0.0, *, y: float, heading: float = 0.0) -> Scene:
        return self.with_actor(x, speed, kind=ActorKind.PEDESTRIAN, y=y, heading=heading, length=0.3, width=0.5)

    def with_lights(self, others: Light = LightState.GREEN, **by_direction: Light) -> Scene:
        """All lights one way, but those of connections straight (s), left (l) or right (r) another."""
        return dataclasses.replace(self, lights=MappingProxyType({"": others, **by_direction}))

    def transformed(self, dx: float, dy: float, angle: float) -> Scene:
        """The same scene turned around the origin, rad, then shifted, m."""
        network = self.network
        lanes = dataclasses.replace(network.lanes, points=_moved(network.lanes.points, dx, dy, angle))
        junctions = dataclasses.replace(network.junctions, points=_moved(network.junctions.points, dx, dy, angle))
        ends = _moved(network.stop_lines.segment.reshape(-1, 2), dx, dy, angle).reshape(-1, 4)
        stop_lines = dataclasses.replace(network.stop_lines, segment=ends)
        bodies = []
        for body in self.bodies:
            x, y = _moved(np.array([[body.x, body.y]]), dx, dy, angle)[0]
            bodies.append(dataclasses.replace(body, x=x, y=y, heading=body.heading + angle))
        network = dataclasses.replace(network, lanes=lanes, junctions=junctions, stop_lines=stop_lines)
        return dataclasses.replace(self, network=network, bodies=tuple(bodies))

    @cached_property
    def route(self) -> Route:
        return plan_route(self.network, self.mission)

    def stop_line(self, lane: str) -> float:
        """x of a stop line across an east-west lane, m."""
        row = int(np.flatnonzero(self.network.stop_lines.lane == self.network.lane_index[lane])[0])
        return float(self.network.stop_lines.segment[row, 0])

    def world(self) -> World:
        """The world in which the scene begins."""
        return self.worlds(seconds=0.0)[0]

    def worlds(self, seconds: float, after: World | None = None) -> list[World]:
        """The world at the start and after every tick.

        Args:
            seconds: How long.
            after: Goes on from there: the egos have jumped to where this scene begins, but time, progress and distance
                continue.
        """
        centres = np.array([[body.x, body.y] for body in self.bodies])
        first = after.tick if after else 0
        worlds = [self._world(first, centres, after, driven=0.0)]
        for tick in range(first + 1, first + round(seconds / TICK_S) + 1):
            step = np.array([_velocity(body, tick * TICK_S) for body in self.bodies]) * TICK_S
            centres = centres + step
            worlds.append(self._world(tick, centres, worlds[-1], driven=np.hypot(*step[: len(self._egos)].T)))
        return worlds

    @property
    def _egos(self) -> list[Body]:
        return [body for body in self.bodies if body.kind is ActorKind.EGO]

    @property
    def _actors(self) -> list[Body]:
        return [body for body in self.bodies if body.kind is not ActorKind.EGO]

    def _with(self, body: Body) -> Scene:
        egos, actors = self._egos, self._actors
        (egos if body.kind is ActorKind.EGO else actors).append(body)
        return dataclasses.replace(self, bodies=(*egos, *actors))

    def _world(self, tick: int, centres: FloatArray, before: World | None, driven: FloatArray | float) -> World:
        time = tick * TICK_S
        egos = self._place_egos(time, centres[: len(self._egos)], before, driven)
        actors = self._place_actors(time, centres[len(self._egos) :])
        return World(
            tick=tick,
            time=time,
            network=self.network,
            routes=(self.route,) * len(self._egos),
            egos=egos,
            actors=actors,
            signals=self._signals(time),
            contacts=_contacts(egos, actors),
            names=tuple(actor.name for actor in self._actors),
        )

    def _place_egos(self, time: float, centres: FloatArray, before: World | None, driven: FloatArray | float) -> Egos:
        bodies, count = self._egos, len(self._egos)
        speed = np.array([max(_at(body.speed, time), 0.0) for body in bodies])
        heading = np.array([body.heading for body in bodies])
        near = before.egos.progress if before else np.full(count, np.nan)
        on_route = [self._project(x, y, s) for (x, y), s in zip(centres, near, strict=True)]
        on_lane = [self._nearest_lane(x, y, angle) for (x, y), angle in zip(centres, heading, strict=True)]
        acceleration = (speed - before.egos.speed) / TICK_S if before else np.zeros(count)
        return Egos(
            names=tuple(body.name for body in bodies),
            active=np.ones(count, dtype=np.bool_),
            position=centres,
            heading=heading,
            speed=speed,
            acceleration=acceleration,
            yaw_rate=np.zeros(count),
            steering=np.zeros(count),
            length=np.array([body.length for body in bodies]),
            width=np.array([body.width for body in bodies]),
            progress=np.array([s for s, _, _ in on_route]),
            lateral=np.array([offset for _, offset, _ in on_route]),
            route_heading_error=wrap_angle(heading - np.array([direction for _, _, direction in on_route])),
            lane=np.array([lane for lane, _, _ in on_lane], dtype=np.int64),
            lane_offset=np.array([offset for _, offset, _ in on_lane]),
            lane_heading_error=np.array([error for _, _, error in on_lane]),
            driven=(before.egos.driven if before else np.zeros(count)) + driven,
            motion=np.stack([np.repeat(acceleration[:, None], 10, axis=1), np.zeros((count, 10))], axis=2),
        )

    def _project(self, x: float, y: float, near: float) -> tuple[float, float, float]:
        """Progress, lateral and direction; on all of the route where nothing is known of the progress so far."""
        if np.isnan(near):
            return self.route.project(x, y, 0.0, ahead=self.route.length)
        return self.route.project(x, y, near)

    def _nearest_lane(self, x: float, y: float, heading: float) -> tuple[int, float, float]:
        return self.network.nearest_lane(x, y, heading, self.route.on_route)

    def _place_actors(self, time: float, centres: FloatArray) -> Actors:
        bodies = self._actors
        on_lane = [self._nearest_lane(x, y, body.heading) for body, (x, y) in zip(bodies, centres, strict=True)]
        half_width = self.network.lanes.width / 2
        return Actors(
            key=np.arange(len(bodies)),
            kind=np.array([body.kind for body in bodies], dtype=np.int64),
            position=centres.reshape(-1, 2),
            heading=np.array([body.heading for body in bodies], dtype=np.float64),
            speed=np.array([abs(_at(body.speed, time)) for body in bodies], dtype=np.float64),
            length=np.array([body.length for body in bodies], dtype=np.float64),
            width=np.array([body.width for body in bodies], dtype=np.float64),
            lane=np.array([lane if abs(d) <= half_width[lane] else -1 for lane, d, _ in on_lane], dtype=np.int64),
            indicator=np.zeros(len(bodies), dtype=np.int64),
        )

    def _signals(self, time: float) -> IntArray:
        state = np.full(len(self.network.signals.link), _at(self.lights[""], time), dtype=np.int64)
        connections = self.network.connections
        for direction, light in self.lights.items():
            state[connections.signal[(connections.direction == direction) & (connections.signal >= 0)]] = _at(
                light, time
            )
        return state


def _at(value: T | Callable[[float], T], time: float) -> T:
    return value(time) if callable(value) else value


def _velocity(body: Body, time: float) -> tuple[float, float]:
    speed, drift = _at(body.speed, time), _at(body.drift, time)
    cos, sin = math.cos(body.heading), math.sin(body.heading)
    return speed * cos - drift * sin, speed * sin + drift * cos


def _moved(points: FloatArray, dx: float, dy: float, angle: float) -> FloatArray:
    cos, sin = math.cos(angle), math.sin(angle)
    return np.array(points @ np.array([[cos, sin], [-sin, cos]]) + (dx, dy))


def _contacts(egos: Egos, actors: Actors) -> tuple[Contact, ...]:
    boxes = np.array([egos.box(ego) for ego in range(len(egos.names))])
    touched = boxes_overlap(boxes, actors.boxes()).nonzero()
    found = [
        Contact(int(ego), int(actors.key[row]), ActorKind(actors.kind[row]), int(row))
        for ego, row in zip(*touched, strict=True)
    ]
    mutual = zip(*boxes_overlap(boxes, boxes).nonzero(), strict=True)
    return (*found, *(Contact(int(a), -1 - int(b), ActorKind.EGO, int(b)) for a, b in mutual if a != b))


def run(scene: Scene | Sequence[World], *criteria: Criterion, seconds: float = 2.0, ego: int = 0) -> Judge:
    """Lets criteria judge an ego, through all worlds even where its episode ends before.

    Args:
        scene: What happens; or its worlds.
        criteria: Those to ask; all of them by default.
        seconds: How long, for a scene.
        ego: Whom to watch.
    """
    worlds = scene.worlds(seconds) if isinstance(scene, Scene) else scene
    anywhere = Mission(start=Place(lane=""), goal=Place(lane=""))
    judge = Judge(Scenario(network="hand-made", missions=(anywhere,)), ego, criteria or None)
    judge.start(worlds[0])
    endings = [judge.update(before, after) for before, after in pairwise(worlds)]
    judge.end(next((ending for ending in endings if ending), Status.FINISHED))
    return judge


def kinds(judge: Judge) -> list[InfractionKind]:
    """What a judge found, in the order of time."""
    return [infraction.kind for infraction in judge.infractions]


@cache
def straight_road() -> Scene:
    """1 km from west to east, two lanes each way: eastbound at y = -4.8 and -1.6, westbound at 1.6 and 4.8."""
    nodes = '<node id="w" x="0" y="0"/><node id="e" x="1000" y="0"/>'
    network = _build("straight_road", nodes, _road("w", "e") + _road("e", "w"))
    return Scene(network, Mission(start=Place(lane="w_e_0"), goal=Place(lane="w_e_0", position_m=-1.0)))


@cache
def lit_crossing() -> Scene:
    """Four arms of 200 m with two lanes each way, traffic lights in the middle at the origin.

    The mission leads straight through, in the right lane (w_c_0, for straight and right); the left lane is for straight
    and left. A road that meets no other, "a_b", passes over the western stop line towards the north-east.
    """
    return Scene(_crossing("traffic_light"), _straight_through())


@cache
def stop_sign_crossing() -> Scene:
    """The same with stop signs: who comes from the west or the east must stop, north-south has priority."""
    return Scene(_crossing("priority_stop"), _straight_through())


@cache
def bridge() -> Scene:
    """The lit crossing, with a mission on the road that passes over a stop line. Its headings are 45 degrees."""
    mission = Mission(start=Place(lane="a_b_0"), goal=Place(lane="a_b_0", position_m=-1.0))
    return Scene(_crossing("traffic_light"), mission)


@cache
def crossing_for_pedestrians() -> Scene:
    """The lit crossing with sidewalks and zebra crossings; cars drive in w_c_1 and w_c_2, people walk in w_c_0."""
    network = _crossing("traffic_light", "--sidewalks.guess", "true", "--crossings.guess", "true")
    return Scene(network, Mission(start=Place(lane="w_c_1"), goal=Place(lane="c_e_1", position_m=-1.0)))


def _straight_through() -> Mission:
    return Mission(start=Place(lane="w_c_0"), goal=Place(lane="c_e_0", position_m=-1.0))


@cache
def _crossing(kind: str, *options: str) -> RoadNetwork:
    arms = {"w": (-200, 0), "e": (200, 0), "n": (0, 200), "s": (0, -200)}
    nodes = f'<node id="c" x="0" y="0" type="{kind}"/><node id="a" x="-60" y="-47.6"/><node id="b" x="40" y="52.4"/>'
    nodes += "".join(f'<node id="{name}" x="{x}" y="{y}"/>' for name, (x, y) in arms.items())
    edges = "".join(_road(arm, "c", arm in "ns") + _road("c", arm) for arm in arms)
    return _build(f"crossing_{kind}", nodes, edges + _road("a", "b"), *options)


def _road(start: str, end: str, major: bool = False) -> str:
    return (
        f'<edge id="{start}_{end}" from="{start}" to="{end}" priority="{2 if major else 1}" numLanes="2"'
        f' speed="13.89" width="{LANE_M}"/>'
    )


def _build(name: str, nodes: str, edges: str, *options: str) -> RoadNetwork:
    """Builds a net from plain XML, or takes the one built from the same XML and options before."""
    plain = {"nod": f"<nodes>{nodes}</nodes>", "edg": f"<edges>{edges}</edges>"}
    digest = hashlib.sha256("".join([*plain.values(), *options]).encode()).hexdigest()[:16]
    net = cache_folder() / "hand-made" / f"{name}-{digest}.net.xml"
    if not net.exists():
        net.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=net.parent) as folder:
            for kind, text in plain.items():
                (Path(folder) / f"x.{kind}.xml").write_text(text)
            command = [str(Path(sumo.SUMO_HOME) / "bin" / "netconvert"), "-n", "x.nod.xml", "-e", "x.edg.xml"]
            command += ["-o", "x.net.xml", "--no-turnarounds", "true", "--offset.disable-normalization", "true"]
            subprocess.run([*command, *options], cwd=folder, check=True, capture_output=True)
            os.replace(Path(folder) / "x.net.xml", net)
    return read_network(net, name)
