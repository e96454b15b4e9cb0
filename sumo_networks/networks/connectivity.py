"""Connectivity: the lanes from which cars can reach each other."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_matrix  # type: ignore[import-untyped]
from scipy.sparse.csgraph import connected_components  # type: ignore[import-untyped]

from dohyo.sumo_networks.arrays import BoolArray
from dohyo.sumo_networks.networks.network import RoadNetwork


def largest_part(network: RoadNetwork) -> BoolArray:
    """(L,) whether a lane is in the largest strongly connected set of lanes, by connections and lane changes."""
    lanes, connections = network.lanes, network.connections
    drives = lanes.drivable[connections.source] & lanes.drivable[connections.target]
    sources, targets = [connections.source[drives]], [connections.target[drives]]
    for side in (lanes.left, lanes.right):
        has = np.flatnonzero((side >= 0) & lanes.drivable)
        sources.append(has)
        targets.append(side[has])
    ends = np.concatenate(sources), np.concatenate(targets)
    graph = csr_matrix((np.ones(len(ends[0])), ends), shape=(len(lanes.ids), len(lanes.ids)))
    _, part = connected_components(graph, directed=True, connection="strong")
    inside: BoolArray = lanes.drivable & (part == np.bincount(part[lanes.drivable]).argmax())
    return inside
