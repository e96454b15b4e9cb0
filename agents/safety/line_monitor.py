"""Line monitor: whether the ego is about to run a red light, by the distance that RSS keeps from what stands."""

from __future__ import annotations

from typing import Final

from dohyo.agents.safety.rss import EGO, RssConstants, behind_distance
from dohyo.sumo_networks.arrays import Float32Array
from dohyo.sumo_networks.units import TICK_S
from dohyo.sumo_networks.world import LightState

MARGIN_M: Final = 0.5
"""Distance from the line at which an ego stands that does not creep on."""
YELLOW_M_S2: Final = 3.5
"""Braking with which an ego still stops at yellow; harder than that it drives on, as in `lights.lp`."""


class LineMonitor:
    """A closed line is an actor that stands: too near for its speed, the ego is in a critical interval.

    The interval lasts until the response time after the last danger, as that of `RssMonitor`.

    Attributes:
        critical: Whether the ego is in a critical interval.
    """

    def __init__(self, constants: RssConstants = EGO) -> None:
        self._constants = constants
        self.reset()

    def reset(self) -> None:
        """Clears the state of the last episode."""
        self.critical, self._left_s = False, 0.0

    def update(self, speed: float, junctions: Float32Array) -> None:
        """Updates by one tick.

        Args:
            speed: Of the ego, m/s.
            junctions: (4, 4), see `sensors.junctions_ahead`.
        """
        least = behind_distance(speed, 0.0, self._constants.numbers) + MARGIN_M
        danger = any(_closed(speed, float(row[0]), int(row[2])) and row[0] < least for row in junctions)
        self._left_s = self._constants.reaction_s if danger else max(self._left_s - TICK_S, 0.0)
        self.critical = danger or self._left_s > 0.0


def _closed(speed: float, distance: float, light: int) -> bool:
    """Whether a light ahead forbids to pass its line."""
    if distance <= 0.0:
        return False
    return light == LightState.RED or (light == LightState.YELLOW and speed**2 / (2.0 * distance) < YELLOW_M_S2)
