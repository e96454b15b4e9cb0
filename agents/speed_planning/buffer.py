"""Buffer: a segment before a standing bottleneck in which traffic is made denser, and so slower, in advance.

A policy chooses the buffer's density; the fundamental diagram turns it into a speed.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

import numpy as np

from dohyo.agents.learning.networks.policy import TanhActor
from dohyo.agents.speed_planning.fundamental_diagram import FundamentalDiagram
from dohyo.sumo_networks.arrays import BoolArray, FloatArray
from dohyo.sumo_networks.errors import InvalidInputError

RELEASE_M = 600.0
"""Stretch after the buffer in which vehicles speed up before the bottleneck, m; ours.

A buffer that reached the bottleneck would itself be the queue that makes its capacity drop.
"""
UPSTREAM_M, DOWNSTREAM_M, CELL_M = 6000.0, 1200.0, 300.0
"""Part of the road around the bottleneck that a policy sees, and its resolution."""
WATCHED_M = 900.0
"""Stretch before the bottleneck that the rule watches."""
CELLS = round((UPSTREAM_M + DOWNSTREAM_M) / CELL_M)
TRAINED_M = 2400.0
"""Length of the buffer whose density is learned."""
SLOWEST_MPS = 4.0
"""Speed of the densest buffer that a policy may request, m/s."""
CHECKPOINT = Path(__file__).with_name("checkpoints") / "buffer.safetensors"


@dataclass(frozen=True, slots=True)
class Squeeze:
    """A bottleneck by its lanes.

    Attributes:
        before: Lanes upstream of it.
        inside: Lanes in it; the same number for other kinds of bottlenecks.
    """

    before: int
    inside: int


class BufferPolicy(Protocol):
    """Policy of the buffer: its density, and its length."""

    @property
    def length_m(self) -> float:
        """Length of the buffer, m."""

    def density(self, profile: FloatArray, squeeze: Squeeze, diagram: FundamentalDiagram) -> FloatArray:
        """(..., CELLS) veh/m and lane around the bottleneck -> (...) veh/m and lane requested in the buffer.

        The critical density is no request: its speed is the free one.
        """


@dataclass(slots=True)
class RuleBuffer:
    """Holds the last stretch before the bottleneck at a density at which it does not break down, by integral feedback.

    The buffer stores the excess of the demand: while the stretch is too dense, the buffer becomes denser every minute,
    and its outflow stays below its inflow. It stores its length times the change of its density. So a long buffer can
    slow down a little each minute for as long as demand exceeds the capacity. A short one would reach its lowest speed
    after a few minutes.

    Attributes:
        wanted_mps: Speed of the last `WATCHED_M` before the bottleneck, somewhat above that of its greatest flow.
        gain: Change of the buffer's density per minute, over the stretch's density above the wanted one.
        fastest: Greatest such change, veh/m; on 6 km of 4 lanes 0.0005 hold back 720 veh/h, if all follow.
        slowest_mps: Lowest speed of the buffer; below, it would be the queue that it should prevent.
        length_m: Of the buffer.

    Source: the feedback is ALINEA's, as in mainstream traffic flow control (Carlson, Papamichail, Papageorgiou 2011).
    """

    wanted_mps: float = 24.0
    gain: float = 0.2
    fastest: float = 0.0005
    slowest_mps: float = 12.0
    length_m: float = 6000.0
    _asked: FloatArray = field(default_factory=lambda: np.zeros(()), init=False)

    def density(self, profile: FloatArray, squeeze: Squeeze, diagram: FundamentalDiagram) -> FloatArray:
        """Densities of one publication, for any number of roads; the next one continues from them."""
        tail = profile[..., bottleneck_cell() - round(WATCHED_M / CELL_M) : bottleneck_cell()].mean(axis=-1)
        wanted, most = diagram.density(np.array([self.wanted_mps, self.slowest_mps]))
        change = np.clip(self.gain * (tail - wanted), -self.fastest, self.fastest)
        least = diagram.critical_density
        self._asked = np.clip(np.maximum(self._asked, least) + change, least, most)
        return self._asked


@dataclass(frozen=True, slots=True)
class LearnedBuffer:
    """A trained policy.

    Attributes:
        actor: Its network.
        length_m: Of the buffer, as it was trained.
    """

    actor: TanhActor
    length_m: float = TRAINED_M

    @classmethod
    def shipped(cls) -> LearnedBuffer:
        """Shipped policy, see `buffer_training`.

        Raises:
            InvalidInputError: Its checkpoint is missing.
        """
        return cls(TanhActor.load(CHECKPOINT))

    def density(self, profile: FloatArray, squeeze: Squeeze, diagram: FundamentalDiagram) -> FloatArray:
        """Density chosen by the network, between the critical one and that of the slowest buffer."""
        action = self.actor.act(observation(profile, squeeze, diagram)).astype(np.float64)
        return density_of_action(action[..., 0], diagram)


def in_buffer(position_m: FloatArray, bottleneck_m: float, length_m: float) -> BoolArray:
    """(...) whether positions lie in the buffer of a bottleneck that begins there; NaN does not."""
    end = bottleneck_m - RELEASE_M
    return (position_m >= end - length_m) & (position_m < end)


def bottleneck_cell() -> int:
    """The first cell of a profile that is in the bottleneck."""
    return round(UPSTREAM_M / CELL_M)


def observation(profile: FloatArray, squeeze: Squeeze, diagram: FundamentalDiagram) -> FloatArray:
    """(..., CELLS + 1) what a learned policy sees: densities over the jam's, and the lanes that go on.

    Raises:
        InvalidInputError: A profile of another length.
    """
    if profile.shape[-1] != CELLS:
        raise InvalidInputError(f"expected a density profile of {CELLS} cells, got {profile.shape[-1]}")
    lanes = np.full((*profile.shape[:-1], 1), squeeze.inside / squeeze.before)
    return np.concatenate([profile / diagram.jam_density, lanes], axis=-1)


def density_of_action(action: FloatArray, diagram: FundamentalDiagram) -> FloatArray:
    """An action in [-1, 1] as a density: -1 is no request, 1 the slowest buffer."""
    most = diagram.density(np.asarray(SLOWEST_MPS))
    share = (np.clip(action, -1, 1) + 1) / 2
    return np.asarray(diagram.critical_density + share * (most - diagram.critical_density))


def action_of_density(density: FloatArray, diagram: FundamentalDiagram) -> FloatArray:
    """Inverse of `density_of_action`."""
    most = diagram.density(np.asarray(SLOWEST_MPS))
    return np.asarray(2 * (density - diagram.critical_density) / (most - diagram.critical_density) - 1)
