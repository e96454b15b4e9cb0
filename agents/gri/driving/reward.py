"""GRIAD's reward of a tick: speed, position and heading; what ends an episode is worth -1.

r = r_speed + r_position + r_heading: r_speed is 1 at the target speed and falls linearly with the error; r_position is
0 at the route's middle and -1 at 2 m from it; r_heading is minus the angle to the route [rad]. The highest is 1, which
is r_demo.

Source: Chekroun 2024, section 4.3, whose total is "normalized between 0 and 1" although two of its terms are negative.
"""

from __future__ import annotations

from enum import StrEnum
from typing import Final

from dohyo.agents.gri.driving.target_speed import FREE_M_S
from dohyo.sumo_networks.rules.contacts import is_touched
from dohyo.sumo_networks.rules.red_signal import passed_red
from dohyo.sumo_networks.units import TICK_S
from dohyo.sumo_networks.world import World

FARTHEST_M: Final = 2.0
STANDING_M_S, STANDING_S, FREE_TO_GO_M_S = 0.3, 15.0, 1.0
"""An ego slower than the first for the second, while its target speed is above the third, stands without a reason."""
ENDED: Final = -1.0


class End(StrEnum):
    """Why an episode ended in failure."""

    COLLISION = "collision"
    RED_LIGHT = "red_light"
    OFF_LANE = "off_lane"
    STANDING = "standing"


class GriadReward:
    """Reward of one ego in one episode."""

    def __init__(self) -> None:
        self._stood_s = 0.0

    def tick(self, before: World, after: World, target: float, ego: int = 0) -> tuple[float, End | None]:
        """Reward of a tick, and how the episode failed in it.

        Args:
            before: The world before the tick.
            after: The world after it.
            target: Target speed after it, m/s.
            ego: Index of the ego.
        """
        egos = after.egos
        speed, lateral = float(egos.speed[ego]), abs(float(egos.lateral[ego]))
        stands = speed < STANDING_M_S and target > FREE_TO_GO_M_S
        self._stood_s = self._stood_s + TICK_S if stands else 0.0
        end = self._end(before, after, lateral, ego)
        if end is not None:
            return ENDED, end
        error = abs(speed - target) / FREE_M_S
        return 1.0 - error - lateral / FARTHEST_M - abs(float(egos.route_heading_error[ego])), None

    def _end(self, before: World, after: World, lateral: float, ego: int) -> End | None:
        if is_touched(after, ego):
            return End.COLLISION
        if passed_red(before, after, ego):
            return End.RED_LIGHT
        if lateral > FARTHEST_M:
            return End.OFF_LANE
        return End.STANDING if self._stood_s > STANDING_S - TICK_S / 2 else None
