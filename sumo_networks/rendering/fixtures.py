"""Fixtures: traffic-light heads and stop signs, placed at the network's stop lines."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from dohyo.sumo_networks.arrays import FloatArray, IntArray
from dohyo.sumo_networks.networks.network import RoadNetwork
from dohyo.sumo_networks.rendering.surfaces import CellIndex

BEYOND_M = 8.0
HEAD_GAP_M = 0.9
OVERHANG_M = 2.5
SIGN_ASIDE_M = 0.7
_FROM_LEFT = {"t": 0, "l": 1, "L": 2, "s": 3, "R": 4, "r": 5}


@dataclass(frozen=True)
class Fixtures:
    """All heads, wires and signs of a network; m and rad, network frame.

    Attributes:
        heads: (H, 3) x, y, direction of the traffic that the head faces.
        signal: (H,) signal that the head shows.
        wires: (W, 4) both ends of the wire over a road that carries the heads.
        signs: (S, 3) x, y, direction of the traffic that the sign faces.
    """

    heads: FloatArray
    signal: IntArray
    wires: FloatArray
    signs: FloatArray
    head_cells: CellIndex
    wire_cells: CellIndex
    sign_cells: CellIndex


@lru_cache(maxsize=4)
def fixtures_of(network: RoadNetwork) -> Fixtures:
    """Fixtures of a network.

    SUMO has no positions of lights and signs. Here one head per signal hangs over each lane, 8 m beyond its stop line,
    in the order of the turns, and one sign stands to the right of a road's stop lines.
    """
    heads: list[tuple[float, ...]] = []
    signal: list[int] = []
    roads: dict[int, list[FloatArray]] = {}
    signs: dict[int, FloatArray] = {}
    lines, connections = network.stop_lines, network.connections
    for row in range(len(lines.lane)):
        lane = int(lines.lane[row])
        right, left = lines.segment[row, :2], lines.segment[row, 2:]
        across = (left - right) / max(float(np.hypot(*(left - right))), 1e-9)
        along = np.array([across[1], -across[0]])
        direction = math.atan2(along[1], along[0])
        edge = int(network.lanes.edge[lane])
        if lines.lit[row]:
            turns = {
                int(connections.signal[c]): _FROM_LEFT.get(str(connections.direction[c]), 3)
                for c in network.connections_from(lane)
                if connections.signal[c] >= 0
            }
            shown = sorted(turns, key=lambda one: (turns[one], one))
            middle = (right + left) / 2 + along * BEYOND_M
            for number, one in enumerate(shown):
                aside = ((len(shown) - 1) / 2 - number) * HEAD_GAP_M
                heads.append((*(middle + across * aside), direction))
                signal.append(one)
            roads.setdefault(edge, []).extend([right + along * BEYOND_M, left + along * BEYOND_M])
        elif lines.stop_sign[row] and (edge not in signs or network.lanes.right[lane] < 0):
            signs[edge] = np.array([*(right - across * SIGN_ASIDE_M), direction])
    head_rows = np.array(heads, dtype=np.float64).reshape(-1, 3)
    wire_rows = np.array([_wire(np.array(ends)) for ends in roads.values()], dtype=np.float64).reshape(-1, 4)
    sign_rows = np.array(list(signs.values()), dtype=np.float64).reshape(-1, 3)
    cells = [CellIndex(rows[:, :2]) for rows in (head_rows, wire_rows, sign_rows)]
    return Fixtures(
        heads=head_rows[cells[0].order],
        signal=np.array(signal, dtype=np.int64)[cells[0].order],
        wires=wire_rows[cells[1].order],
        signs=sign_rows[cells[2].order],
        head_cells=cells[0],
        wire_cells=cells[1],
        sign_cells=cells[2],
    )


def _wire(ends: FloatArray) -> FloatArray:
    """(4,) line through the outermost of several points, slightly extended."""
    across = ends[-1] - ends[0]
    across = across / max(float(np.hypot(*across)), 1e-9)
    at = ends @ across
    first, last = ends[int(np.argmin(at))], ends[int(np.argmax(at))]
    return np.concatenate([first - across * OVERHANG_M, last + across * OVERHANG_M])
