"""Traffic lights: facts about them that a network's arrays do not hold."""

from __future__ import annotations

import numpy as np

from dohyo.sumo_networks.networks.network import RoadNetwork
from dohyo.sumo_networks.networks.xml_guard import read_elements

LONGEST_PHASE_S = 150.0
"""A driver who waits for 180 s counts as blocked; a light that another program must switch has longer phases."""


def longest_phases(network: RoadNetwork) -> dict[str, float]:
    """Longest phase of every traffic light, s, by its id."""
    longest: dict[str, float] = {}
    light = ""

    def element(tag: str, attributes: dict[str, str]) -> None:
        nonlocal light
        if tag == "tlLogic":
            light = attributes.get("id", "")
            longest.setdefault(light, 0.0)
        elif tag == "phase":
            longest[light] = max(longest.get(light, 0.0), duration_s(attributes.get("duration", "0")))

    read_elements(network.path, element)
    return longest


def duration_s(duration: str) -> float:
    """A duration as SUMO reads it: seconds, or [days:]hours:minutes:seconds; 0 for what is none."""
    *larger, seconds = duration.split(":")
    try:
        return float(seconds) + sum(
            float(number) * unit for number, unit in zip(reversed(larger), (60, 3600, 86400), strict=False)
        )
    except ValueError:
        return 0.0


def endless_lights(network: RoadNetwork) -> frozenset[str]:
    """Ids of traffic lights with a phase so long that a driver at red counts as blocked."""
    return frozenset(light for light, seconds in longest_phases(network).items() if seconds > LONGEST_PHASE_S)


def lights_at_bends(network: RoadNetwork) -> frozenset[str]:
    """Ids of traffic lights where cars from each road go on to one other road, so that no two of their ways meet."""
    lanes, connections = network.lanes, network.connections
    found = set()
    lit = connections.signal >= 0
    lit &= lanes.drivable[connections.source] & lanes.drivable[connections.target] & (connections.direction != "t")
    light = np.where(lit, network.signals.light[connections.signal], -1) if len(network.signals.light) else lit - 1
    for row, name in enumerate(network.signals.light_ids.tolist()):
        ways = {
            (int(lanes.edge[connections.source[one]]), network.edge_behind(int(connections.target[one])))
            for one in np.flatnonzero(light == row).tolist()
        }
        if ways and len({source for source, _ in ways}) == len({target for _, target in ways}) == len(ways) <= 2:
            found.add(name)
    return frozenset(found)


def junctions_of(network: RoadNetwork, light: str) -> list[str]:
    """Ids of the junctions that a traffic light controls."""
    row = network.signals.light_ids.tolist().index(light)
    signals = np.flatnonzero(network.signals.light == row)
    targets = network.connections.target[np.isin(network.connections.signal, signals)]
    inside = targets[network.lanes.internal[targets]]
    return sorted({str(network.lanes.ids[lane])[1:].rsplit("_", 2)[0] for lane in inside.tolist()})


def roads_into(network: RoadNetwork, light: str) -> set[str]:
    """Ids of the edges whose ends a traffic light controls."""
    row = network.signals.light_ids.tolist().index(light)
    signals = np.flatnonzero(network.signals.light == row)
    sources = network.connections.source[np.isin(network.connections.signal, signals)]
    return {network.edge_id(lane) for lane in sources.tolist()}


def crossings_at(network: RoadNetwork, light: str) -> int:
    """Number of pedestrian crossings at the junctions that a traffic light controls."""
    crossings = [str(lane) for lane in network.lanes.ids[network.lanes.crossing]]
    beginnings = tuple(f":{junction}_c" for junction in junctions_of(network, light))
    return sum(lane.startswith(beginnings) for lane in crossings) if beginnings else 0
