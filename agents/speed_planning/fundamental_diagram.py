"""Fundamental diagrams: flow and speed by density, per lane; and density by speed.

Two shapes: Greenshields' parabola, in which the PDE-ODE of moving bottlenecks was first written, and the triangle,
which fits a freeway better and is what the planner uses, calibrated on (density, speed) pairs.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.errors import InvalidInputError

LEAST_PAIRS = 20


class FundamentalDiagram(Protocol):
    """Flow over density on one lane; rho in veh/m, flow in veh/s, speed in m/s; every method takes arrays."""

    @property
    def free_speed_mps(self) -> float:
        """Speed on an empty lane."""

    @property
    def jam_density(self) -> float:
        """Density of standing traffic, veh/m."""

    @property
    def critical_density(self) -> float:
        """Density of the greatest flow, veh/m."""

    @property
    def capacity(self) -> float:
        """The greatest flow, veh/s."""

    def flow(self, density: FloatArray) -> FloatArray:
        """Flow, veh/s."""

    def speed(self, density: FloatArray) -> FloatArray:
        """Speed, m/s."""

    def density(self, speed: FloatArray) -> FloatArray:
        """Density of a speed, veh/m: the congested one, from the critical one up to the jam's."""

    def passing_flow(self, speed: FloatArray) -> FloatArray:
        """Highest flow past a vehicle of that speed, veh/s: the maximum of flow(r) - speed r over r."""


@dataclass(frozen=True, slots=True)
class Greenshields:
    """Speed falls linearly with density.

    Attributes:
        free_speed_mps: Speed on an empty lane.
        jam_density: Density of standing traffic, veh/m.
    """

    free_speed_mps: float = 30.0
    jam_density: float = 0.14

    @property
    def critical_density(self) -> float:
        """Half the jam's."""
        return self.jam_density / 2

    @property
    def capacity(self) -> float:
        """The parabola's top."""
        return self.free_speed_mps * self.jam_density / 4

    def flow(self, density: FloatArray) -> FloatArray:
        """The parabola."""
        return density * self.speed(density)

    def speed(self, density: FloatArray) -> FloatArray:
        """The line."""
        return self.free_speed_mps * (1 - np.clip(density / self.jam_density, 0, 1))

    def density(self, speed: FloatArray) -> FloatArray:
        """Inverse of the line; not below the critical density."""
        density = self.jam_density * (1 - np.clip(speed / self.free_speed_mps, 0, 1))
        return np.maximum(density, self.critical_density)

    def passing_flow(self, speed: FloatArray) -> FloatArray:
        """rho_max / (4 V_max) (V_max - speed)^2; Delle Monache and Goatin 2014."""
        slower = np.maximum(self.free_speed_mps - speed, 0)
        return self.jam_density / (4 * self.free_speed_mps) * slower**2


@dataclass(frozen=True, slots=True)
class Triangle:
    """Free speed up to the critical density; beyond, disturbances travel upstream at one speed.

    Attributes:
        free_speed_mps: Speed on an empty lane.
        wave_speed_mps: At which congestion travels upstream.
        jam_density: Density of standing traffic, veh/m.
    """

    free_speed_mps: float = 30.0
    wave_speed_mps: float = 4.5
    jam_density: float = 0.13

    @property
    def critical_density(self) -> float:
        """Density at which the two sides meet, veh/m."""
        return self.wave_speed_mps * self.jam_density / (self.free_speed_mps + self.wave_speed_mps)

    @property
    def capacity(self) -> float:
        """The triangle's tip."""
        return self.free_speed_mps * self.critical_density

    def flow(self, density: FloatArray) -> FloatArray:
        """The lower of the two sides."""
        congested = self.wave_speed_mps * (self.jam_density - np.minimum(density, self.jam_density))
        return np.minimum(self.free_speed_mps * density, congested)

    def speed(self, density: FloatArray) -> FloatArray:
        """Flow over density."""
        return self.flow(density) / np.maximum(density, 1e-9) + self.free_speed_mps * (density <= 0)

    def density(self, speed: FloatArray) -> FloatArray:
        """Density of the congested side; the critical density for the free speed and above."""
        kept = np.clip(speed, 0, self.free_speed_mps)
        return self.wave_speed_mps * self.jam_density / (kept + self.wave_speed_mps)

    def passing_flow(self, speed: FloatArray) -> FloatArray:
        """Reached at the critical density."""
        return np.maximum(self.free_speed_mps - speed, 0) * self.critical_density


FREEWAY = Triangle(free_speed_mps=30.0, wave_speed_mps=4.0, jam_density=0.1146)
"""Of the network `freeway`, measured by `python -m dohyo.agents.speed_planning.study.calibration`.

Its tip is the flow out of congestion; before a breakdown a lane carries a third more, which no triangle can represent.
"""


def calibrated(density: FloatArray, speed: FloatArray) -> Triangle:
    """A triangle fitted to measured pairs.

    The free speed is the median speed of the emptiest fifth; the other side is the line w (rho_jam - rho) through the
    flows of the pairs below 0.6 of it, by the median of the slopes between pairs (Theil and Sen): stop-and-go traffic
    scatters, and least squares would follow its outliers.

    Args:
        density: (n,) veh/m on one lane.
        speed: (n,) m/s, of the same minutes and places.

    Raises:
        InvalidInputError: Fewer than 20 finite pairs, or none of them congested.
    """
    known = np.isfinite(density) & np.isfinite(speed) & (density > 0)
    density, speed = density[known], speed[known]
    if len(density) < LEAST_PAIRS:
        raise InvalidInputError(f"expected at least {LEAST_PAIRS} pairs of density and speed, got {len(density)}")
    free = float(np.median(speed[density <= np.quantile(density, 0.2)]))
    crowded = speed < 0.6 * free
    if np.count_nonzero(crowded) < LEAST_PAIRS // 4:
        raise InvalidInputError(
            "expected some congested pairs of density and speed, got none below 0.6 of the free speed"
        )
    rho, flow = density[crowded], (density * speed)[crowded]
    kept = np.linspace(0, len(rho) - 1, min(len(rho), 400)).astype(int)
    rho, flow = rho[kept], flow[kept]
    first, second = np.triu_indices(len(rho), k=1)
    apart = np.abs(rho[first] - rho[second]) > 0.005
    slopes = (flow[first] - flow[second])[apart] / (rho[first] - rho[second])[apart]
    wave = float(np.clip(-np.median(slopes), 2.0, 8.0)) if apart.any() else Triangle().wave_speed_mps
    jam = float(np.median(rho + flow / wave))
    return Triangle(free, wave, jam)
