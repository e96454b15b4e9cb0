"""Faults of a network that disturb drivers: what is wrong, where it is, and what to do about it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from enum import StrEnum
from types import MappingProxyType

import numpy as np

from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.networks.connectivity import junctions_of_edges
from dohyo.sumo_networks.networks.lights import LONGEST_PHASE_S, crossings_at, lights_at_bends, longest_phases
from dohyo.sumo_networks.networks.network import RoadNetwork
from dohyo.sumo_networks.networks.overpasses import find_overpasses
from dohyo.sumo_networks.units import KMH_PER_MPS

MIN_LENGTH_M = 0.5
MAX_KINK = np.radians(60.0)
# A compact car at full lock: 2.7 m of wheelbase, 0.6 rad at the front wheels.
MIN_RADIUS_M = 4.0
CURVATURE_SPAN_M = 3.0
OVERPASS_SIZE_M = 50.0
"""Distance within which crossings of the lanes of two roads are one place."""
PLAUSIBLE_KMH = (8.0, 150.0)
"""Speed limits of roads; those of living streets begin at 10 km/h."""


class FaultKind(StrEnum):
    """Kinds of faults."""

    SHORT = "short lane"
    KINK = "kink"
    CURVATURE = "tight bend"
    LIGHT_AT_BEND = "light at a bend"
    LONG_PHASE = "endless light"
    LIMIT = "implausible limit"
    OVERPASS = "roads that cross without a junction"
    NO_LANES = "junction without lanes"


@dataclass(frozen=True, slots=True)
class FaultMeaning:
    """Explanation of a kind of fault.

    Attributes:
        unit: Unit of the value.
        remedy: Advice to the owner of the network.
    """

    unit: str
    remedy: str


_BY_HAND = "mend the geometry in netedit, or let no mission pass here"
MEANINGS: Mapping[FaultKind, FaultMeaning] = MappingProxyType(
    {
        FaultKind.SHORT: FaultMeaning("m long", "join its two junctions in netedit"),
        FaultKind.KINK: FaultMeaning("degrees", _BY_HAND),
        FaultKind.CURVATURE: FaultMeaning("m of radius", "no drawn mission passes here; or mend it in netedit"),
        FaultKind.LIGHT_AT_BEND: FaultMeaning(
            "crossings", "import with --fix removes it where nobody crosses; one with crossings stays"
        ),
        FaultKind.LONG_PHASE: FaultMeaning("s, longest phase", "import with --fix: gives the light a usual program"),
        FaultKind.LIMIT: FaultMeaning("km/h", "import with --fix: sets the usual limit of the network"),
        FaultKind.NO_LANES: FaultMeaning(
            "ways through it", "run netconvert -s FILE --no-internal-links false -o NEW, and import NEW"
        ),
        FaultKind.OVERPASS: FaultMeaning(
            "degrees between them", "no drawn mission passes here: even on a bridge, cars of one road are on the other"
        ),
    }
)


@dataclass(frozen=True, slots=True)
class Fault:
    """A suspicious place of a network.

    Attributes:
        kind: Kind of the fault.
        name: SUMO id of the lane, of the edge (limits), of the traffic light or of the junction; where roads cross
            without one, those of both edges.
        value: Measured value, in the unit of its kind.
        x_m: Place in the network frame, m.
        y_m: Place in the network frame, m.
    """

    kind: FaultKind
    name: str
    value: float
    x_m: float
    y_m: float

    @property
    def summary(self) -> str:
        """Name, value and place, for people."""
        return f"{self.name}: {self.value:g} {MEANINGS[self.kind].unit}, at x {self.x_m:.0f}, y {self.y_m:.0f}"


def find_faults(network: RoadNetwork) -> tuple[Fault, ...]:
    """All faults of a network; those of its geometry inside junctions too."""
    return (*_lights(network), *_limits(network), *_geometry(network), *_overpasses(network), *_junctions(network))


def usual_limit(network: RoadNetwork) -> float:
    """Most frequent plausible speed limit, by the length of lanes, m/s."""
    lanes = network.lanes
    road = lanes.drivable & ~lanes.internal & _plausible(lanes.speed)
    limits, which = np.unique(lanes.speed[road], return_inverse=True)
    return float(limits[np.bincount(which, lanes.length[road]).argmax()]) if len(limits) else 50 / KMH_PER_MPS


def _plausible(speed: FloatArray) -> np.ndarray:
    low, high = PLAUSIBLE_KMH
    return (speed * KMH_PER_MPS >= low) & (speed * KMH_PER_MPS <= high)


def _lights(network: RoadNetwork) -> Iterator[Fault]:
    phases, bends = longest_phases(network), lights_at_bends(network)
    for row, light in enumerate(network.signals.light_ids.tolist()):
        seconds = phases.get(light, 0.0)
        if light in bends or seconds > LONGEST_PHASE_S:
            endless = seconds > LONGEST_PHASE_S
            kind = FaultKind.LONG_PHASE if endless else FaultKind.LIGHT_AT_BEND
            value = seconds if endless else crossings_at(network, light)
            signals = np.flatnonzero(network.signals.light == row)
            lanes = np.unique(network.connections.source[np.isin(network.connections.signal, signals)])
            ends = network.lanes.points[network.lanes.start[lanes + 1] - 1]
            yield _fault(kind, light, value, ends.mean(axis=0))


def _limits(network: RoadNetwork) -> Iterator[Fault]:
    lanes = network.lanes
    wrong = np.flatnonzero(lanes.drivable & ~lanes.internal & ~_plausible(lanes.speed))
    _, first = np.unique(lanes.edge[wrong], return_index=True)
    for lane in wrong[first].tolist():
        middle = network.lane_point(lane, float(lanes.length[lane]) / 2)
        kmh = round(float(lanes.speed[lane]) * KMH_PER_MPS, 1)
        yield _fault(FaultKind.LIMIT, network.edge_id(lane), kmh, np.array(middle[:2]))


def _geometry(network: RoadNetwork) -> Iterator[Fault]:
    lanes, connections = network.lanes, network.connections
    turning_round = set(connections.target[connections.direction == "t"].tolist())
    for lane in np.flatnonzero(lanes.drivable).tolist():
        name, length, shape = str(lanes.ids[lane]), float(lanes.length[lane]), network.lane_shape(lane)
        if not lanes.internal[lane] and length < MIN_LENGTH_M:
            yield _fault(FaultKind.SHORT, name, round(length, 2), shape[0])
        if lane in turning_round:
            continue
        kink, radius = _sharpest(shape)
        if kink > MAX_KINK:
            yield _fault(FaultKind.KINK, name, round(float(np.degrees(kink))), shape[len(shape) // 2])
        elif radius < MIN_RADIUS_M:
            yield _fault(FaultKind.CURVATURE, name, round(radius, 1), shape[len(shape) // 2])


def _overpasses(network: RoadNetwork) -> Iterator[Fault]:
    """One fault for each place where two edges cross; a junction stands for all ways through it."""
    found, places = find_overpasses(network), dict[str, list[FloatArray]]()
    for pair, point, angle in zip(found.lanes.tolist(), found.points, found.angles.tolist(), strict=True):
        names = " and ".join(sorted(_road_name(network, lane) for lane in pair))
        if all(np.hypot(*(point - place)) > OVERPASS_SIZE_M for place in places.setdefault(names, [])):
            places[names].append(point)
            yield _fault(FaultKind.OVERPASS, names, round(float(np.degrees(angle))), point)


def _junctions(network: RoadNetwork) -> Iterator[Fault]:
    """Junctions that cars cross without a lane, and so outside all lanes."""
    lanes, connections = network.lanes, network.connections
    road = lanes.drivable & ~lanes.internal
    bare = connections.source[road[connections.source] & road[connections.target]]
    junctions = junctions_of_edges(network)[lanes.edge[bare], 1]
    for junction in np.unique(junctions[junctions >= 0]).tolist():
        sources = bare[junctions == junction]
        place = lanes.points[lanes.start[sources + 1] - 1].mean(axis=0)
        yield _fault(FaultKind.NO_LANES, str(network.junctions.ids[junction]), len(sources), place)


def _road_name(network: RoadNetwork, lane: int) -> str:
    edge = network.edge_id(lane)
    return f"junction {edge[1:].rpartition('_')[0]}" if network.lanes.internal[lane] else edge


def _fault(kind: FaultKind, name: str, value: float, place: FloatArray) -> Fault:
    return Fault(kind, name, value, round(float(place[0]), 1), round(float(place[1]), 1))


def _sharpest(shape: FloatArray) -> tuple[float, float]:
    """Largest angle between two segments of a line [rad], and its smallest radius over 3 m [m]."""
    steps = np.diff(shape, axis=0)
    lengths = np.hypot(steps[:, 0], steps[:, 1])
    steps, lengths = steps[lengths > 0.05], lengths[lengths > 0.05]
    if len(steps) < 2:
        return 0.0, np.inf
    heading = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
    kink = float(np.abs(np.diff(heading)).max())
    middle = np.cumsum(lengths) - lengths / 2
    at = np.arange(0.0, lengths.sum() + 1e-9, 0.5)
    span = max(int(CURVATURE_SPAN_M / 0.5), 1)
    if len(at) <= span:
        return kink, np.inf
    sampled = np.interp(at, middle, heading)
    turn = float(np.abs(sampled[span:] - sampled[:-span]).max())
    return kink, CURVATURE_SPAN_M / turn if turn > 1e-9 else np.inf
