"""The interface of a planner: what a policy worker sees and decides in a freeway morning."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from dohyo.evaluation.families import PLANNING_CONTROL
from dohyo.sumo_networks.errors import InvalidInputError

TRACK: Final = "privileged"
STATE: Final = "speeds"
"""The planner's only sensor: (lanes, cells) of speeds, m/s."""
DECIDES_EVERY_S: Final = 60.0
"""Simulated time between two plans, s."""


def check_planner(track: str, sensors: Sequence[str]) -> None:
    """Checks the specification of a planner.

    Raises:
        InvalidInputError: A planner has another track, or other sensors.
    """
    if track != TRACK or list(sensors) != [STATE]:
        raise InvalidInputError(
            f"control '{PLANNING_CONTROL}' is that of a planner of freeway mornings: expected track '{TRACK}' and "
            f"sensors ['{STATE}'], got track '{track}' and {list(sensors)}"
        )
