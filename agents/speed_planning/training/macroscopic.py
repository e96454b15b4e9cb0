"""Freeways as cells of traffic, many at once: a bottleneck with a capacity drop, and moving bottlenecks.

The cell transmission model (Daganzo 1994) with two additions. Once a queue stands before the bottleneck, less passes it
(the capacity drop). A controlled vehicle that drives slower than the traffic is a moving bottleneck: past one at
speed y' flows at most alpha max_r(f(r) - y' r) + y' rho (the PDE-ODE of Delle Monache and Goatin 2014), where alpha is
the share of lanes that it leaves free.

Ours: each further controlled vehicle in the same cell closes another lane; vehicles that find the first cell
full wait before it; and all roads are advanced by one set of array operations, so that a policy learns in minutes.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from dohyo.agents.speed_planning.fundamental_diagram import FundamentalDiagram, Triangle
from dohyo.sumo_networks.arrays import BoolArray, FloatArray, IntArray
from dohyo.sumo_networks.errors import InvalidInputError


@dataclass(frozen=True)
class CellRoad:
    """Road, the same for all R copies.

    Attributes:
        cell_m: Length of one cell.
        lanes: (C,) lanes of each cell, from upstream to downstream.
        diagram: Of one lane.
        bottleneck: The cell with the drop; it must have fewer lanes than the one before it.
        drop: Share of the bottleneck's capacity that is lost while a queue stands before it.
        step_s: Time step; a vehicle must not cross a cell in less.

    Raises:
        InvalidInputError: A step too long for the cells, a drop outside [0, 1), or no such bottleneck.
    """

    cell_m: float = 300.0
    lanes: IntArray = field(default_factory=lambda: np.array([4] * 30 + [3] * 8))
    diagram: FundamentalDiagram = field(default_factory=Triangle)
    bottleneck: int = 30
    drop: float = 0.1
    step_s: float = 6.0

    def __post_init__(self) -> None:
        if self.step_s * self.diagram.free_speed_mps > self.cell_m:
            raise InvalidInputError(
                f"expected a step in which {self.diagram.free_speed_mps} m/s stay within {self.cell_m} m, "
                f"got {self.step_s} s"
            )
        if not 0 <= self.drop < 1:
            raise InvalidInputError(f"expected a capacity drop in [0, 1), got {self.drop}")
        if not 0 < self.bottleneck < len(self.lanes):
            raise InvalidInputError(f"expected a bottleneck in cell 1 to {len(self.lanes) - 1}, got {self.bottleneck}")

    @property
    def cells(self) -> int:
        """Number of cells, C."""
        return len(self.lanes)

    @property
    def length_m(self) -> float:
        """Of all cells."""
        return self.cell_m * self.cells


@dataclass(frozen=True)
class CellTraffic:
    """Traffic on R roads at one moment.

    Attributes:
        density: (R, C) veh/m on all lanes of a cell together.
        waiting: (R,) vehicles before the first cell.
        controlled_m: (R, K) positions of the controlled vehicles, m from the road's start; NaN for unused slots.
    """

    density: FloatArray
    waiting: FloatArray
    controlled_m: FloatArray


@dataclass(frozen=True)
class StepFlows:
    """Flows of one step.

    Attributes:
        entered: (R,) vehicles that entered the first cell.
        left: (R,) vehicles that left the last cell.
        discharged: (R,) vehicles that passed into the bottleneck.
    """

    entered: FloatArray
    left: FloatArray
    discharged: FloatArray


def empty(road: CellRoad, roads: int, controlled: int = 0) -> CellTraffic:
    """Empty roads, with slots for controlled vehicles."""
    return CellTraffic(np.zeros((roads, road.cells)), np.zeros(roads), np.full((roads, controlled), np.nan))


def speeds(road: CellRoad, traffic: CellTraffic) -> FloatArray:
    """(R, C) mean speed of each cell, m/s."""
    return road.diagram.speed(traffic.density / road.lanes)


def vehicles(road: CellRoad, traffic: CellTraffic) -> FloatArray:
    """(R,) vehicles on a road and waiting before it."""
    return np.asarray(traffic.density.sum(axis=1) * road.cell_m + traffic.waiting)


def advance(
    road: CellRoad, traffic: CellTraffic, demand: FloatArray, advised: FloatArray | None = None
) -> tuple[CellTraffic, StepFlows]:
    """One step.

    Args:
        road: The road.
        traffic: Before the step.
        demand: (R,) arriving vehicles per second.
        advised: (R, K) speed of each controlled vehicle if the traffic allows it, m/s.

    Returns:
        The traffic after it, and the flows.
    """
    per_lane = traffic.density / road.lanes
    sending, receiving = _demand_and_supply(road, per_lane)
    driven = np.zeros((len(per_lane), 0))
    if advised is not None:
        driven = _driven(road, traffic, road.diagram.speed(per_lane), advised)
        sending = np.minimum(sending, _passing(road, traffic, driven))
    wanting = demand + traffic.waiting / road.step_s
    entering = np.minimum(wanting, receiving[:, 0])
    between = np.minimum(sending[:, :-1], receiving[:, 1:])
    flow = np.concatenate([entering[:, None], between, sending[:, -1:]], axis=1) * road.step_s
    # Rounding may leave -1e-18 in a cell that empties exactly.
    density = np.maximum(traffic.density + (flow[:, :-1] - flow[:, 1:]) / road.cell_m, 0.0)
    waiting = np.maximum(traffic.waiting + demand * road.step_s - flow[:, 0], 0.0)
    moved = traffic.controlled_m
    if advised is not None:
        moved = moved + driven * road.step_s
        moved = np.where(moved < road.length_m, moved, np.nan)
    return CellTraffic(density, waiting, moved), StepFlows(flow[:, 0], flow[:, -1], flow[:, road.bottleneck])


def _demand_and_supply(road: CellRoad, per_lane: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(R, C) highest outflow and inflow of each cell, veh/s, all lanes; lower into the bottleneck with a queue."""
    diagram, critical = road.diagram, road.diagram.critical_density
    sending = diagram.flow(np.minimum(per_lane, critical)) * road.lanes
    receiving = diagram.flow(np.maximum(per_lane, critical)) * road.lanes
    queued = per_lane[:, road.bottleneck - 1] > critical * 1.001
    dropped = (1 - road.drop) * diagram.capacity * road.lanes[road.bottleneck]
    at = receiving[:, road.bottleneck]
    receiving[:, road.bottleneck] = np.where(queued, np.minimum(at, dropped), at)
    return sending, receiving


def _cell_of(road: CellRoad, traffic: CellTraffic) -> tuple[BoolArray, IntArray]:
    there = np.isfinite(traffic.controlled_m)
    cell = np.where(there, traffic.controlled_m, 0.0) // road.cell_m
    return there, np.minimum(cell.astype(np.int64), road.cells - 1)


def _driven(road: CellRoad, traffic: CellTraffic, speed: FloatArray, advised: FloatArray) -> FloatArray:
    """(R, K) y' = min(u, V(rho(y+))), m/s: no vehicle drives faster than the traffic ahead."""
    _, cell = _cell_of(road, traffic)
    ahead = np.minimum(cell + 1, road.cells - 1)
    # Within a cell the traffic of that cell is ahead; only at its end the next one's.
    near = np.where(np.isfinite(traffic.controlled_m), traffic.controlled_m, 0.0) > (cell + 0.5) * road.cell_m
    limit = np.take_along_axis(speed, np.where(near, ahead, cell), axis=1)
    return np.asarray(np.minimum(np.clip(advised, 0.0, None), limit))


def _passing(road: CellRoad, traffic: CellTraffic, driven: FloatArray) -> FloatArray:
    """(R, C) highest outflow of each cell past its controlled vehicles, veh/s; infinite without any."""
    roads = len(traffic.density)
    there, cell = _cell_of(road, traffic)
    flat = (cell + np.arange(roads)[:, None] * road.cells)[there]
    size = roads * road.cells
    count = np.bincount(flat, minlength=size).reshape(roads, road.cells)
    total = np.bincount(flat, weights=driven[there], minlength=size).reshape(roads, road.cells)
    speed = total / np.maximum(count, 1)
    free_lanes = np.maximum(road.lanes - count, 0)
    most = free_lanes * road.diagram.passing_flow(speed) + speed * traffic.density
    return np.where(count > 0, most, np.inf)
