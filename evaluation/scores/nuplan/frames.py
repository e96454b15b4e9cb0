"""Frames: what a record and its trajectory say of one ego and of those around it, tick by tick."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
import shapely

from dohyo.evaluation.criteria.fault import is_at_fault, keeps_to_one_lane
from dohyo.evaluation.records.record import EpisodeRecord
from dohyo.evaluation.records.trajectory import Trajectory
from dohyo.sumo_networks.arrays import BoolArray, FloatArray, IntArray
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.geometry import boxes_overlap
from dohyo.sumo_networks.networks.network import RoadNetwork
from dohyo.sumo_networks.objects import ObjectStates
from dohyo.sumo_networks.routes.route import Route
from dohyo.sumo_networks.routes.routing import plan_route
from dohyo.sumo_networks.units import TICK_S
from dohyo.sumo_networks.world import ActorKind

_AROUND_M = 20.0


@dataclass(frozen=True, slots=True)
class Touch:
    """The first tick in which the ego and somebody else touch.

    Attributes:
        tick: Row of the frames.
        key: Of the other.
        kind: ActorKind of the other.
        at_fault: Whether the ego caused it.
    """

    tick: int
    key: int
    kind: int
    at_fault: bool


@dataclass(frozen=True)
class Frames:
    """One ego's drive, T ticks long.

    Attributes:
        network: The roads.
        route: The ego's.
        boxes: (T, 5) the ego's: x, y [m], heading [rad], length, width [m].
        speed: (T,), m/s.
        progress: (T,), m along the route.
        others: Everybody else in each of the T ticks; other egos are among them, with their keys of the trajectory.
    """

    network: RoadNetwork
    route: Route
    boxes: FloatArray
    speed: FloatArray
    progress: FloatArray
    others: tuple[ObjectStates, ...]

    def __len__(self) -> int:
        return len(self.speed)

    @cached_property
    def lanes(self) -> tuple[IntArray, FloatArray, FloatArray]:
        """(T,) nearest drivable lane or -1, (T,) offset from its middle [m], (T,) heading relative to it [rad]."""
        found = [self.network.nearest_lane(x, y, heading, self.route.on_route) for x, y, heading, _, _ in self.boxes]
        lane, offset, error = zip(*found, strict=True)
        return np.array(lane, dtype=np.int64), np.array(offset), np.array(error)

    @cached_property
    def outside(self) -> FloatArray:
        """(T,), m: how far the farthest corner of the ego is outside the drivable area, 0 within it."""
        points = shapely.points(corners(self.boxes))
        return np.asarray(shapely.distance(_drivable_near(self.network, self.boxes[:, :2]), points).max(axis=1))

    @cached_property
    def keeps_lane(self) -> BoolArray:
        """(T,) whether the ego's corners are all on one lane, or on lanes that follow each other."""
        centre_lanes = self.lanes[0].tolist()
        kept = [keeps_to_one_lane(self.network, box, lane) for box, lane in zip(self.boxes, centre_lanes, strict=True)]
        return np.array(kept, dtype=np.bool_)

    @cached_property
    def in_junction(self) -> BoolArray:
        """(T,) whether the ego's centre is on a lane inside a junction."""
        lane = self.lanes[0]
        return (lane >= 0) & self.network.lanes.internal[lane]

    @cached_property
    def touches(self) -> tuple[Touch, ...]:
        """Everybody the ego touches, each at the first tick, in the order of time."""
        found: dict[int, Touch] = {}
        for tick, others in enumerate(self.others):
            for i in np.flatnonzero(boxes_overlap(self.boxes[tick : tick + 1], others.boxes())[0]).tolist():
                key, kind = int(others.key[i]), int(others.kind[i])
                if key not in found:
                    # An ego that brakes to a stop in the tick of the impact was moving.
                    speed = float(self.speed[max(tick - 1, 0) : tick + 1].max())
                    other_speed = 0.0 if kind == ActorKind.STATIC else float(others.speed[i])
                    fault = is_at_fault(
                        self.boxes[tick],
                        speed,
                        others.box(i),
                        other_speed,
                        tick_s=TICK_S,
                        in_one_lane=bool(self.keeps_lane[tick]),
                    )
                    found[key] = Touch(tick, key, kind, fault)
        return tuple(found.values())


def frames_of(record: EpisodeRecord, trajectory: Trajectory, network: RoadNetwork, ego: int = 0) -> Frames:
    """One ego's frames.

    Args:
        record: Of the episode.
        trajectory: Of the same episode.
        network: On which it was driven.
        ego: Which one.

    Raises:
        InvalidInputError: The trajectory does not hold the ego without gaps, or its mission cannot be driven there.
    """
    route = plan_route(network, record.scenario.missions[ego])
    rows = np.flatnonzero(trajectory.key == -1 - ego)
    ticks = trajectory.tick[rows]
    if not np.array_equal(ticks, np.arange(len(ticks))):
        raise InvalidInputError(f"scenario '{record.scenario.name}': expected every tick of ego {ego} from 0 on")
    first = np.searchsorted(trajectory.tick, np.arange(len(ticks) + 1))
    others = []
    for start, stop in pairwise(first.tolist()):
        some = start + np.flatnonzero(trajectory.key[start:stop] != -1 - ego)
        others.append(trajectory.states(some))
    own, progress = trajectory.states(rows), trajectory.progress[rows].astype(np.float64)
    return Frames(network, route, own.boxes(), own.speed, progress, tuple(others))


def corners(boxes: FloatArray) -> FloatArray:
    """(N, 4, 2), m: corners of (N, 5) boxes."""
    x, y, heading, length, width = boxes.T
    along = 0.5 * length[:, None] * np.array([1.0, 1.0, -1.0, -1.0])
    aside = 0.5 * width[:, None] * np.array([1.0, -1.0, -1.0, 1.0])
    cos, sin = np.cos(heading)[:, None], np.sin(heading)[:, None]
    return np.stack([x[:, None] + along * cos - aside * sin, y[:, None] + along * sin + aside * cos], axis=-1)


def _drivable_near(network: RoadNetwork, points: FloatArray) -> shapely.Geometry:
    """Union of the drivable lanes and junctions around some points; the whole network's takes seconds."""
    low, high = points.min(axis=0) - _AROUND_M, points.max(axis=0) + _AROUND_M
    lanes, junctions = network.lanes, network.junctions

    def near(outline: FloatArray) -> bool:
        return bool((outline.max(axis=0) >= low).all() and (outline.min(axis=0) <= high).all())

    shapes = ((lane, network.lane_shape(lane)) for lane in np.flatnonzero(lanes.drivable).tolist())
    strips = [
        shapely.buffer(shapely.linestrings(shape), lanes.width[lane] / 2, cap_style="flat")
        for lane, shape in shapes
        if near(shape)
    ]
    outlines = (network.junction_shape(j) for j in range(len(junctions.ids)))
    polygons = [shapely.make_valid(shapely.polygons(o)) for o in outlines if len(o) >= 3 and near(o)]
    return shapely.union_all([*strips, *polygons])
