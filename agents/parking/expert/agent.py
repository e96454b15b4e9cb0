"""The expert as an agent of the parking benchmarks."""

from __future__ import annotations

import numpy as np

from dohyo.agents.parking.expert.expert import Expert
from dohyo.agents.parking.expert.scene import Scene, scene_of
from dohyo.evaluation.parking.agent import ParkingSpec
from dohyo.sumo_networks.arrays import Float32Array, FloatArray
from dohyo.sumo_networks.parking.rows import LotView


class ExpertAgent:
    """Hybrid A* and a tracker, with the whole lot known.

    Attributes:
        spec: See `ParkingAgent`.
    """

    def __init__(self, reverse: bool = False) -> None:
        """Prepares.

        Args:
            reverse: Whether its plans may go backwards.
        """
        self.spec = ParkingSpec(name="parking-expert", track="privileged")
        self._reverse, self._expert = reverse, Expert(reverse)
        self._body: FloatArray = np.zeros(0)
        self._scene = Scene(np.zeros((0, 5)), np.zeros((0, 7)), np.zeros(5))

    def reset(self, seed: int) -> None:
        """See `ParkingAgent`."""
        self._expert = Expert(self._reverse)

    def look(self, lot: LotView, number: int) -> None:
        """See `ParkingAgent`."""
        self._body, self._scene = lot.karts[number], scene_of(lot, number)

    def act(self, observation: Float32Array) -> Float32Array:
        """See `ParkingAgent`."""
        return self._expert.act(self._body, self._scene).astype(np.float32)

    def close(self) -> None:
        """See `ParkingAgent`."""
