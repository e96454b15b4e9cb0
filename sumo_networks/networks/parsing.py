"""Parsing: a SUMO net file becomes arrays, by sumolib."""

from __future__ import annotations

import gzip
import hashlib
import xml.sax
import zlib
from collections.abc import Iterable
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import sumolib

from dohyo.sumo_networks.errors import InvalidInputError

Tables = dict[str, np.ndarray]


def file_hash(path: Path) -> str:
    """Hex sha256 of a net file's bytes.

    Raises:
        InvalidInputError: The file cannot be read.
    """
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError as error:
        raise InvalidInputError(f"cannot read network file '{path}': {error.strerror}") from error


def parse_net(path: Path) -> Tables:
    """Reads a SUMO net that `xml_guard.scan` has accepted into flat arrays, named "group.field" as in `network.py`.

    Raises:
        InvalidInputError: The file is no SUMO net, has no lane open to cars, or has a lane or junction of an impossible
            size or shape.
    """
    net = _read(path)
    edges = sorted(net.getEdges(), key=lambda edge: str(edge.getID()))
    lanes = [lane for edge in edges for lane in edge.getLanes()]
    if not any(_drives(lane) for lane in lanes):
        raise InvalidInputError(f"network file '{path}' has no lane open to passenger cars")
    order = {lane.getID(): i for i, lane in enumerate(lanes)}
    signals = sorted({(c.getTLSID(), c.getTLLinkIndex()) for c in _connections(lanes) if c.getTLSID()})
    try:
        tables = _lane_tables(edges, lanes, order)
        tables |= _connection_tables(lanes, order, {key: i for i, key in enumerate(signals)})
        tables |= _signal_tables(signals)
        tables |= _stop_line_tables(tables)
        tables |= _junction_tables(net)
    except InvalidInputError as error:
        raise InvalidInputError(f"network file '{path}': {error}") from error
    return tables


def _read(path: Path) -> Any:
    try:
        return sumolib.net.readNet(str(path), withInternal=True, withPedestrianConnections=False, withFoes=True)
    except (xml.sax.SAXException, EOFError, gzip.BadGzipFile, zlib.error, OSError) as error:
        raise InvalidInputError(f"network file '{path}' is broken: {error}") from error
    except (KeyError, ValueError, AttributeError, IndexError) as error:
        raise InvalidInputError(f"network file '{path}' is no complete SUMO network: {error!r}") from error


def _drives(lane: Any) -> bool:
    return bool(lane.allows("passenger")) and lane.getEdge().getFunction() not in ("crossing", "walkingarea")


def _connections(lanes: Iterable[Any]) -> list[Any]:
    return [c for lane in lanes for c in lane.getOutgoing() if c.getFrom().getFunction() not in _ON_FOOT]


_ON_FOOT = ("crossing", "walkingarea")


def _lane_tables(edges: list[Any], lanes: list[Any], order: dict[str, int]) -> Tables:
    edge_order = {edge.getID(): i for i, edge in enumerate(edges)}
    shapes = [_checked_shape(lane) for lane in lanes]
    drivable = np.array([_drives(lane) for lane in lanes])
    left, right = np.full(len(lanes), -1), np.full(len(lanes), -1)
    for edge in edges:
        if edge.getFunction() != "internal":
            open_lanes = [order[lane.getID()] for lane in edge.getLanes() if _drives(lane)]
            for a, b in pairwise(open_lanes):
                if b == a + 1:
                    left[a], right[b] = b, a
    function = [lane.getEdge().getFunction() for lane in lanes]
    return {
        "lanes.ids": np.array([lane.getID() for lane in lanes], dtype=np.str_),
        "lanes.edge": np.array([edge_order[lane.getEdge().getID()] for lane in lanes]),
        "lanes.index": np.array([lane.getIndex() for lane in lanes]),
        "lanes.length": np.array([lane.getLength() for lane in lanes], dtype=np.float64),
        "lanes.width": np.array([lane.getWidth() for lane in lanes], dtype=np.float64),
        "lanes.speed": np.array([lane.getSpeed() for lane in lanes], dtype=np.float64),
        "lanes.drivable": drivable,
        "lanes.bicycle": np.array([lane.allows("bicycle") for lane in lanes]),
        "lanes.pedestrian": np.array([lane.allows("pedestrian") for lane in lanes]),
        "lanes.internal": np.array([f == "internal" for f in function]),
        "lanes.crossing": np.array([f == "crossing" for f in function]),
        "lanes.left": left,
        "lanes.right": right,
        "lanes.start": np.concatenate([[0], np.cumsum([len(shape) for shape in shapes])]),
        "lanes.points": np.concatenate(shapes),
        "lanes.edge_ids": np.array(list(edge_order), dtype=np.str_),
    }


def _checked_shape(lane: Any) -> np.ndarray:
    """(P, 2) a lane's centreline without repeated points, or the outline of a walking area as it is.

    Inside junctions SUMO itself makes lanes of 0.1 m whose two points are equal. They keep both points.
    """
    name = f"lane '{lane.getID()}'"
    if not 0.0 < lane.getLength() < np.inf:
        raise InvalidInputError(f"{name}: expected a finite length above 0 m, got {lane.getLength():g}")
    for what, value in (("width", lane.getWidth()), ("speed", lane.getSpeed())):
        if not np.isfinite(value):
            raise InvalidInputError(f"{name}: expected a finite {what}, got {value:g}")
    shape = _finite(name, lane.getShape())
    if len(shape) < 2:
        raise InvalidInputError(f"{name}: expected a shape of at least two points, got {len(shape)}")
    if lane.getEdge().getFunction() == "walkingarea":
        return shape
    line = shape[np.append(True, (shape[1:] != shape[:-1]).any(axis=1))]
    if len(line) == 1 and not lane.getEdge().isSpecial():
        raise InvalidInputError(f"{name}: expected a shape of two different points, got only {_text(shape[0])}")
    return np.repeat(line, 2, axis=0) if len(line) == 1 else np.asarray(line)


def _finite(name: str, points: Iterable[Any]) -> np.ndarray:
    """(P, 2) points of a lane or junction."""
    shape = np.array([point[:2] for point in points], dtype=np.float64).reshape(-1, 2)
    for point in shape[~np.isfinite(shape).all(axis=1)]:
        raise InvalidInputError(f"{name}: expected finite coordinates, got {_text(point)}")
    return shape


def _text(point: np.ndarray) -> str:
    return f"{point[0]:g},{point[1]:g}"


def _connection_tables(lanes: list[Any], order: dict[str, int], signals: dict[tuple[str, int], int]) -> Tables:
    rows, links = [], []
    for number, c in enumerate(_connections(lanes)):
        via = c.getViaLaneID()
        inside = c.getFrom().getFunction() == "internal"
        rows.append(
            (
                order[c.getFromLane().getID()],
                order[via] if via else order[c.getToLane().getID()],
                "i" if inside else c.getDirection(),
                signals[(c.getTLSID(), c.getTLLinkIndex())] if c.getTLSID() and not inside else -1,
                c.getState(),
                number,
            )
        )
        links.append(c)
    rows.sort()
    source = np.array([row[0] for row in rows], dtype=np.int64)
    return {
        "connections.source": source,
        "connections.target": np.array([row[1] for row in rows], dtype=np.int64),
        "connections.direction": np.array([row[2] for row in rows], dtype="<U1"),
        "connections.signal": np.array([row[3] for row in rows], dtype=np.int64),
        "connections.control": np.array([row[4] for row in rows], dtype="<U1"),
        "connections.first": np.searchsorted(source, np.arange(len(lanes) + 1)),
        "connections.yields": _yields([links[row[-1]] for row in rows]),
    }


def _yields(links: list[Any]) -> np.ndarray:
    """(Y, 2) pairs of connections of one junction: the first must give way to the second."""
    by_junction: dict[str, list[int]] = {}
    for i, link in enumerate(links):
        if link.getFrom().getFunction() != "internal":
            by_junction.setdefault(link.getFrom().getToNode().getID(), []).append(i)
    pairs = []
    for members in by_junction.values():
        node = links[members[0]].getFrom().getToNode()
        index = {i: node.getLinkIndex(links[i]) for i in members}
        for i in members:
            # The same as sumolib's node.forbids(), without its look-up of both indices for every pair.
            response = node._prohibits.get(index[i], "")[::-1]
            pairs += [(i, j) for j in members if response[index[j] : index[j] + 1] == "1"]
    return np.array(pairs, dtype=np.int64).reshape(-1, 2)


def _signal_tables(signals: list[tuple[str, int]]) -> Tables:
    lights = sorted({light for light, _ in signals})
    return {
        "signals.light_ids": np.array(lights, dtype=np.str_),
        "signals.light": np.array([lights.index(light) for light, _ in signals], dtype=np.int64),
        "signals.link": np.array([link for _, link in signals], dtype=np.int64),
    }


def _stop_line_tables(tables: Tables) -> Tables:
    source, control = tables["connections.source"], tables["connections.control"]
    lit = np.unique(source[tables["connections.signal"] >= 0])
    signed = np.unique(source[np.isin(control, ["s", "w"])])
    lanes = np.array(sorted(i for i in {*lit, *signed} if tables["lanes.drivable"][i]), dtype=np.int64)
    segments = np.empty((len(lanes), 4))
    for row, lane in enumerate(lanes):
        end = tables["lanes.points"][tables["lanes.start"][lane] : tables["lanes.start"][lane + 1]][-2:]
        if (end[0] == end[1]).all():
            raise InvalidInputError(f"lane '{tables['lanes.ids'][lane]}': expected a direction at its stop line")
        along = (end[1] - end[0]) / np.hypot(*(end[1] - end[0]))
        across = np.array([-along[1], along[0]]) * tables["lanes.width"][lane] / 2
        segments[row] = [*(end[1] - across), *(end[1] + across)]
    return {
        "stop_lines.lane": lanes,
        "stop_lines.segment": segments,
        "stop_lines.lit": np.isin(lanes, lit),
        "stop_lines.stop_sign": np.isin(lanes, signed),
    }


def _junction_tables(net: Any) -> Tables:
    nodes = sorted((n for n in net.getNodes() if n.getType() != "internal"), key=lambda n: str(n.getID()))
    shapes = [_finite(f"junction '{node.getID()}'", node.getShape()) for node in nodes]
    return {
        "junctions.ids": np.array([node.getID() for node in nodes], dtype=np.str_),
        "junctions.kind": np.array([node.getType() for node in nodes], dtype=np.str_),
        "junctions.start": np.concatenate([[0], np.cumsum([len(shape) for shape in shapes])]),
        "junctions.points": np.concatenate(shapes),
    }
