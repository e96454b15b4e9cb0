"""The freeway as one axis: position along the mainline and segment of each lane of the SUMO net."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.config import Config
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.networks.catalog import load_network
from dohyo.sumo_networks.networks.entries import network_folder
from dohyo.sumo_networks.networks.network import RoadNetwork

MAINLINE = "mainline.toml"


class OnRamp(Config):
    """A ramp on which vehicles enter.

    Attributes:
        segment: Segment at whose start the ramp joins.
        peak_vph: Vehicles per hour at the peak of an ordinary morning.
    """

    segment: int
    peak_vph: float


class OffRamp(Config):
    """A ramp on which vehicles leave.

    Attributes:
        segment: Segment at whose end the ramp leaves.
        share: Share of the vehicles before the ramp that take it.
    """

    segment: int
    share: float


class Mainline(Config):
    """Content of `catalog/NAME/mainline.toml`; edges are SUMO's ids, from upstream to downstream.

    Attributes:
        approach: Edges before the first segment.
        segments: Edges of each segment.
        departure: Edges after the last segment.
        bottleneck: Number of the segment with the least capacity.
        peak_vph: Vehicles per hour on the approach at the peak of an ordinary morning.
        on_ramps: On-ramps by edge, from upstream to downstream.
        off_ramps: Off-ramps by edge, from upstream to downstream.
    """

    approach: tuple[str, ...]
    segments: tuple[tuple[str, ...], ...]
    departure: tuple[str, ...]
    bottleneck: int
    peak_vph: float
    on_ramps: dict[str, OnRamp]
    off_ramps: dict[str, OffRamp]

    @property
    def edges(self) -> tuple[str, ...]:
        """All edges of the mainline, from upstream to downstream."""
        return (*self.approach, *(edge for segment in self.segments for edge in segment), *self.departure)


@dataclass(frozen=True, slots=True)
class MainlineLane:
    """One SUMO lane on the mainline's axis.

    Attributes:
        start_m: Position of the lane's start, m.
        lane: Number from the left, 0 the leftmost, so that ramps do not change the numbers of other lanes.
    """

    start_m: float
    lane: int


@dataclass(frozen=True, eq=False)
class FreewayRoad:
    """A freeway, seen along its mainline. Positions are in m from the start of the first segment, downstream positive.

    Attributes:
        network: The road network.
        mainline: Edges of the mainline by part, and the ramps.
        tracks: Place of each SUMO lane of the mainline, junctions included and ramps excluded, by lane id.
        bounds_m: (S + 1,) borders of the segments, m.
        lanes: (S,) smallest number of lanes of each segment.
        start_m: Position of the approach's start, m; negative.
        end_m: Position of the departure's end, m.
    """

    network: RoadNetwork
    mainline: Mainline
    tracks: dict[str, MainlineLane]
    bounds_m: FloatArray
    lanes: tuple[int, ...]
    start_m: float
    end_m: float

    @property
    def segments(self) -> int:
        """Number of segments, S."""
        return len(self.bounds_m) - 1

    @property
    def lengths_m(self) -> FloatArray:
        """(S,) length of each segment, m."""
        return np.asarray(np.diff(self.bounds_m))

    @property
    def joins_m(self) -> FloatArray:
        """Positions of the entries, m: the approach's start, then the junction of each on-ramp."""
        return np.array([self.start_m, *(self.bounds_m[ramp.segment] for ramp in self.mainline.on_ramps.values())])

    @property
    def leaves_m(self) -> FloatArray:
        """Positions of the exits, m: the departure's end, then the junction of each off-ramp."""
        return np.array([self.end_m, *(self.bounds_m[ramp.segment + 1] for ramp in self.mainline.off_ramps.values())])

    def way(self, entry: int, exit: int) -> tuple[str, ...]:
        """Edges from an entry to an exit, numbered as in `joins_m` and `leaves_m`.

        Raises:
            InvalidInputError: The exit does not lie downstream of the entry.
        """
        if not self.joins_m[entry] < self.leaves_m[exit]:
            raise InvalidInputError(f"exit {exit} does not lie downstream of entry {entry}")
        line, edges = self.mainline, self.mainline.edges
        first, last = 0, len(edges)
        before: tuple[str, ...] = ()
        after: tuple[str, ...] = ()
        if entry:
            name, joins = list(line.on_ramps.items())[entry - 1]
            first, before = edges.index(line.segments[joins.segment][0]), (name,)
        if exit:
            name, leaves = list(line.off_ramps.items())[exit - 1]
            last, after = edges.index(line.segments[leaves.segment][-1]) + 1, (name,)
        return (*before, *edges[first:last], *after)

    def edge_at(self, position_m: float) -> tuple[str, float]:
        """Edge of the mainline at a position [m], and the distance along that edge, m."""
        starts = {edge: self.tracks[f"{edge}_0"].start_m for edge in self.mainline.edges}
        edge = max((edge for edge in starts if starts[edge] <= position_m), key=lambda edge: starts[edge])
        return edge, position_m - starts[edge]

    @property
    def bottleneck_m(self) -> float:
        """Position of the bottleneck's start, m."""
        return float(self.bounds_m[self.mainline.bottleneck])


@lru_cache(maxsize=4)
def load_freeway(name: str = "freeway") -> FreewayRoad:
    """A freeway by its catalog name.

    Raises:
        InvalidInputError: The name is unknown, the network is no freeway, or the mainline's edges do not join.
    """
    network = load_network(name)
    path = network_folder(name) / MAINLINE
    if not path.is_file():
        raise InvalidInputError(f"network '{name}' is no freeway: expected '{MAINLINE}' in its folder")
    return _laid_out(network, Mainline.read_toml(path))


def _laid_out(network: RoadNetwork, mainline: Mainline) -> FreewayRoad:
    edges = mainline.edges
    lanes = {edge: _lanes_of(network, edge) for edge in edges}
    starts: dict[str, float] = {}
    tracks: dict[str, MainlineLane] = {}
    at = 0.0
    for place, edge in enumerate(edges):
        starts[edge] = at
        _add_tracks(tracks, network, lanes[edge], at)
        at += float(network.lanes.length[lanes[edge][0]])
        if place + 1 < len(edges):
            inside = _between(network, lanes[edge], lanes[edges[place + 1]])
            _add_tracks(tracks, network, inside, at)
            at += float(network.lanes.length[inside[0]])
    zero = starts[mainline.segments[0][0]]
    first_after = starts[mainline.departure[0]] if mainline.departure else at
    bounds = [starts[segment[0]] - zero for segment in mainline.segments] + [first_after - zero]
    return FreewayRoad(
        network=network,
        mainline=mainline,
        tracks={lane: MainlineLane(track.start_m - zero, track.lane) for lane, track in tracks.items()},
        bounds_m=np.array(bounds),
        lanes=tuple(min(len(lanes[edge]) for edge in segment) for segment in mainline.segments),
        start_m=-zero,
        end_m=at - zero,
    )


def _add_tracks(tracks: dict[str, MainlineLane], network: RoadNetwork, lanes: list[int], at: float) -> None:
    for place, lane in enumerate(reversed(lanes)):
        tracks[str(network.lanes.ids[lane])] = MainlineLane(at, place)


def _lanes_of(network: RoadNetwork, edge: str) -> list[int]:
    """Lanes of an edge open to cars, from right to left."""
    rows = np.flatnonzero((network.lanes.edge_ids[network.lanes.edge] == edge) & network.lanes.drivable)
    if not len(rows):
        raise InvalidInputError(f"mainline of network '{network.name}': expected an edge with lanes, got '{edge}'")
    return sorted(rows.tolist(), key=lambda row: int(network.lanes.index[row]))


def _between(network: RoadNetwork, before: list[int], after: list[int]) -> list[int]:
    """The lanes inside the junction that joins two edges of the mainline, from right to left."""
    links = network.connections
    leads = set(links.source[np.isin(links.target, after)].tolist())
    inside = {int(links.target[link]) for lane in before for link in network.connections_from(lane)} & leads
    if not inside:
        names = [str(network.lanes.edge_ids[network.lanes.edge[lanes[0]]]) for lanes in (before, after)]
        raise InvalidInputError(f"mainline of '{network.name}': no lane leads from '{names[0]}' to '{names[1]}'")
    return sorted(inside, key=lambda row: int(network.lanes.index[row]))
