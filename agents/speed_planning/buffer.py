"""The buffer: a segment before a standing bottleneck in which traffic is asked to be denser, and so slower, in advance.

A policy chooses the buffer's density; the fundamental diagram turns it into a speed.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np

from agents.speed_planning.fundamental_diagram import FundamentalDiagram
from agents.speed_planning.ppo import Actor
from sumo_networks.arrays import BoolArray, FloatArray
from sumo_networks.errors import InvalidInputError

BUFFER_M, RELEASE_M = 2400.0, 600.0
"""Length of the buffer, and of the stretch after it in which vehicles get up to speed before the bottleneck; ours.

A buffer that reached the bottleneck would itself be the queue that makes its capacity drop.
"""
UPSTREAM_M, DOWNSTREAM_M, CELL_M = 6000.0, 1200.0, 300.0
"""Which part of the road around the bottleneck a policy sees, and how finely."""
CELLS = round((UPSTREAM_M + DOWNSTREAM_M) / CELL_M)
SLOWEST_MPS = 4.0
"""The speed of the densest buffer a policy may ask for."""
CHECKPOINT = Path(__file__).with_name("checkpoints") / "buffer.safetensors"


@dataclass(frozen=True, slots=True)
class Squeeze:
    """A bottleneck by its lanes.

    Attributes:
        before: Lanes upstream of it.
        inside: Lanes in it; the same number where something else holds traffic up.
    """

    before: int
    inside: int


class BufferPolicy(Protocol):
    """Chooses the density of the buffer."""

    def density(self, profile: FloatArray, squeeze: Squeeze, diagram: FundamentalDiagram) -> FloatArray:
        """(..., CELLS) veh/m and lane around the bottleneck -> (...) veh/m and lane asked for in the buffer.

        The critical density asks for nothing: its speed is the free one.
        """


@dataclass(frozen=True, slots=True)
class RuleBuffer:
    """Asks for the density at which just as much arrives as the bottleneck can carry without a queue.

    Attributes:
        margin: Share of the bottleneck's capacity that may arrive.
        crowded: Mean density in the last 1.5 km, as a share of the critical one, from which on the rule acts.
    """

    margin: float = 0.97
    crowded: float = 1.1

    def density(self, profile: FloatArray, squeeze: Squeeze, diagram: FundamentalDiagram) -> FloatArray:
        """Of the congested side, where flow over all lanes equals the bottleneck's."""
        wanted = self.margin * diagram.capacity * min(squeeze.inside / squeeze.before, 1.0)
        grid = np.linspace(diagram.critical_density, diagram.jam_density, 400)
        chosen = grid[np.argmin(np.abs(diagram.flow(grid) - wanted))]
        tail = profile[..., bottleneck_cell() - 5 : bottleneck_cell()].mean(axis=-1)
        busy = tail >= self.crowded * diagram.critical_density
        return np.where(busy, chosen, diagram.critical_density)


@dataclass(frozen=True, slots=True)
class LearnedBuffer:
    """A trained policy.

    Attributes:
        actor: Its network.
    """

    actor: Actor

    @classmethod
    def shipped(cls) -> LearnedBuffer:
        """The one trained in `buffer_training`.

        Raises:
            InvalidInputError: Its checkpoint is not there.
        """
        return cls(Actor.load(CHECKPOINT))

    def density(self, profile: FloatArray, squeeze: Squeeze, diagram: FundamentalDiagram) -> FloatArray:
        """What the network chooses, between the critical density and that of the slowest buffer."""
        return density_of_action(self.actor.act(observation(profile, squeeze, diagram))[..., 0], diagram)


def in_buffer(position_m: FloatArray, bottleneck_m: float) -> BoolArray:
    """(...) whether positions lie in the buffer of a bottleneck that begins there; NaN does not."""
    end = bottleneck_m - RELEASE_M
    return (position_m >= end - BUFFER_M) & (position_m < end)


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
    """An action in [-1, 1] as a density: -1 asks for nothing, 1 for the slowest buffer."""
    most = diagram.density(np.asarray(SLOWEST_MPS))
    share = (np.clip(action, -1, 1) + 1) / 2
    return np.asarray(diagram.critical_density + share * (most - diagram.critical_density))
