"""Connectivity: the lanes from which cars can reach each other, and the junctions between them."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy.sparse import csr_matrix  # type: ignore[import-untyped]
from scipy.sparse.csgraph import connected_components  # type: ignore[import-untyped]

from dohyo.sumo_networks.arrays import BoolArray, IntArray
from dohyo.sumo_networks.networks.network import RoadNetwork
from dohyo.sumo_networks.networks.xml_guard import read_elements


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


@lru_cache(maxsize=8)
def junctions_of_edges(network: RoadNetwork) -> IntArray:
    """(E, 2) junctions where each edge begins and ends, as the net says; -1 where it says none."""
    row = {str(name): i for i, name in enumerate(network.junctions.ids)}
    edges = {str(name): i for i, name in enumerate(network.lanes.edge_ids)}
    found = np.full((len(edges), 2), -1, dtype=np.int64)

    def element(tag: str, attributes: dict[str, str]) -> None:
        edge = edges.get(attributes.get("id", "")) if tag == "edge" else None
        if edge is not None:
            inside = attributes["id"].startswith(":")
            at = attributes["id"][1:].rpartition("_")[0] if inside else ""
            ends = (at, at) if inside else (attributes.get("from", ""), attributes.get("to", ""))
            found[edge] = [row.get(end, -1) for end in ends]

    read_elements(network.path, element)
    return found
