"""Frames: the states of one ego and of all actors around it, tick by tick, from a record and its trajectory."""

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
    """First contact of the ego with another actor.

    Attributes:
        tick: Tick of the contact, a row of the frames.
        key: Key of the other actor.
        kind: ActorKind of the other actor.
        at_fault: Whether the ego caused the contact.
    """

    tick: int
    key: int
    kind: int
    at_fault: bool


@dataclass(frozen=True)
class Frames:
    """One ego's drive, T ticks long.

    Attributes:
        network: Network that was driven on.
        route: Route of the ego.
        boxes: (T, 5) boxes of the ego: x, y [m], heading [rad], length, width [m].
        speed: (T,) speed of the ego, m/s.
        progress: (T,) progress of the ego along its route, m.
        others: States of all other actors in each of the T ticks, other egos included, with their keys of the
            trajectory.
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
        """(T,) distance of the ego's farthest corner from the drivable area [m]; 0 within the area."""
        points = shapely.points(corners(self.boxes))
        return np.asarray(shapely.distance(_drivable_near(self.network, self.boxes[:, :2]), points).max(axis=1))

    @cached_property
    def keeps_lane(self) -> BoolArray:
        """(T,) whether all corners of the ego are on one lane, or on lanes that follow each other."""
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
        """First contacts with every actor that the ego touches, in the order of time."""
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
    """The frames of one ego.

    Args:
        record: Record of the episode.
        trajectory: Trajectory of the same episode.
        network: Network that was driven on.
        ego: Index of the ego.

    Raises:
        InvalidInputError: The trajectory of the ego has gaps, or its mission cannot be driven on the network.
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
    """(N, 4, 2) corners of (N, 5) boxes [m]."""
    x, y, heading, length, width = boxes.T
    along = 0.5 * length[:, None] * np.array([1.0, 1.0, -1.0, -1.0])
    aside = 0.5 * width[:, None] * np.array([1.0, -1.0, -1.0, 1.0])
    cos, sin = np.cos(heading)[:, None], np.sin(heading)[:, None]
    return np.stack([x[:, None] + along * cos - aside * sin, y[:, None] + along * sin + aside * cos], axis=-1)


def _drivable_near(network: RoadNetwork, points: FloatArray) -> shapely.Geometry:
    """Union of the drivable lanes and junctions around some points; a union over the whole network takes seconds."""
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
