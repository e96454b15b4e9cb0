"""Line monitor: whether the ego is about to run a red light or a stop sign, by RSS's distance from what stands."""

from __future__ import annotations

import math
from typing import Final

from dohyo.agents.planning.stop_signs import NextStop
from dohyo.agents.safety.rss import EGO, RssConstants, behind_distance
from dohyo.agents.safety.rss_monitor import response_ticks
from dohyo.sumo_networks.arrays import Float32Array
from dohyo.sumo_networks.world import LightState

MARGIN_M: Final = 0.5
"""Distance from the line at which an ego stands that does not creep on."""
YELLOW_M_S2: Final = 3.5
"""Braking with which an ego still stops at yellow; harder than that it drives on, as in `lights.lp`."""
STANDS_M_S, STOOD_M = 0.1, 4.0
"""Below this speed, so near to a stop sign's line, an ego has stopped there; as the infraction is judged."""
LIT: Final = (LightState.RED, LightState.YELLOW, LightState.GREEN)


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
        self.critical, self._left = False, 0
        self._stop = NextStop(STANDS_M_S, STOOD_M)

    def update(self, speed: float, junctions: Float32Array) -> None:
        """Updates by one tick.

        Args:
            speed: Of the ego, m/s.
            junctions: (4, 4), see `sensors.junctions_ahead`.
        """
        least = behind_distance(speed, 0.0, self._constants.numbers) + MARGIN_M
        self._stop.update(speed, junctions)
        danger = any(_closed(speed, float(row[0]), int(row[2])) and row[0] < least for row in junctions)
        danger = danger or (self._must_stop(junctions) and self._stop.distance < least)
        self._left = response_ticks(self._constants) if danger else max(self._left - 1, 0)
        self.critical = danger or self._left > 0

    def _must_stop(self, junctions: Float32Array) -> bool:
        stop = self._stop
        return 0.0 < stop.distance < math.inf and not stop.stood and int(junctions[stop.row, 2]) not in LIT


def _closed(speed: float, distance: float, light: int) -> bool:
    """Whether a light ahead forbids to pass its line."""
    if distance <= 0.0:
        return False
    return light == LightState.RED or (light == LightState.YELLOW and speed**2 / (2.0 * distance) < YELLOW_M_S2)
