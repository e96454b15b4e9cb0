"""Flows: vehicles that follow each other along one path with gaps, in addition to the constant population."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.networks.network import RoadNetwork
from dohyo.sumo_networks.routes.edge_graph import edge_graph
from dohyo.sumo_networks.scenario import TrafficFlow

_HOUR_S = 3600.0


@dataclass(slots=True)
class FlowSource:
    """One flow of a scenario on its network.

    Attributes:
        type: Name of a vType in vehicle_types.add.xml; None: mixed as in the population.
        edges: SUMO edge ids of the fastest path from source to target.
        lane: Index of the lane on the first edge on which all vehicles enter; None: the best lane each time.
        gap_s: Bounds of the uniformly distributed time between two vehicles, s; None: random times.
        mean_s: Mean time between two vehicles, s.
        rng: Generator of the gaps.
    """

    type: str | None
    edges: tuple[str, ...]
    lane: int | None
    gap_s: tuple[float, float] | None
    mean_s: float
    rng: np.random.Generator
    _next_s: float = field(init=False)

    def __post_init__(self) -> None:
        self._next_s = float(self.rng.uniform(0.0, self.mean_s))

    def due(self, time_s: float) -> Iterator[None]:
        """Yields one item for each vehicle that is due by a time."""
        while self._next_s <= time_s:
            self._next_s += float(self.rng.uniform(*self.gap_s) if self.gap_s else self.rng.exponential(self.mean_s))
            yield


def make_flow_sources(
    network: RoadNetwork, flows: Sequence[TrafficFlow], rng: np.random.Generator
) -> tuple[FlowSource, ...]:
    """Makes the flows of a scenario on its network, each with its own generator.

    Raises:
        InvalidInputError: An edge does not exist or is closed to the flow's vehicles, or no path leads to the target.
    """
    if not flows:
        return ()
    children = rng.spawn(len(flows))
    return tuple(_stream(flow, i, network, children[i]) for i, flow in enumerate(flows))


def _stream(flow: TrafficFlow, number: int, network: RoadNetwork, rng: np.random.Generator) -> FlowSource:
    what = f"traffic.flows[{number}]"
    kind: Literal["drivable", "bicycle"] = "bicycle" if flow.type == "bicycle" else "drivable"
    lane = network.lane_index.get(flow.source)
    source = flow.source if lane is None else network.edge_id(lane)
    permitted = getattr(network.lanes, kind)
    for role, edge in (("source", source), ("target", flow.target)):
        lanes = network.lanes_of_edge.get(edge)
        if lanes is None:
            raise InvalidInputError(f"{what}: network '{network.name}' has no edge '{edge}' ({role})")
        if not permitted[lanes].any() or network.lanes.internal[lanes].any():
            raise InvalidInputError(f"{what}: no {flow.type or 'car'} may drive on edge '{edge}' ({role})")
    if lane is not None and not permitted[lane]:
        raise InvalidInputError(f"{what}: no {flow.type or 'car'} may drive on lane '{flow.source}' (source)")
    edges = edge_graph(network, kind).fastest(source, flow.target)
    if not edges:
        raise InvalidInputError(f"{what}: no path leads from edge '{source}' to edge '{flow.target}'")
    first = next(one for one in network.lanes_of_edge[source] if permitted[one])
    gap_s, mean_s = _gaps(flow, float(network.lanes.speed[first if lane is None else lane]))
    index = None if lane is None else int(network.lanes.index[lane])
    return FlowSource(flow.type, edges, index, gap_s, mean_s, rng)


def _gaps(flow: TrafficFlow, limit_mps: float) -> tuple[tuple[float, float] | None, float]:
    """Bounds of the time between two vehicles [s], or None for random times; and the mean time [s]."""
    if flow.vehicles_per_hour is not None:
        return None, _HOUR_S / flow.vehicles_per_hour
    shortest, longest = flow.gap_s or (distance / limit_mps for distance in flow.spacing_m or ())
    return (shortest, longest), 0.5 * (shortest + longest)
