"""The interface of a planner: what a policy or a worker sees and decides in a freeway morning."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any, Final

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


@cache
def plan_shape() -> tuple[int, int]:
    """(lanes, cells) of what a planner sees and decides, on the road of the mornings."""
    from dohyo.agents.speed_planning.traffic_state import LaneGrid  # reads the network
    from dohyo.sumo_networks.freeway.road import load_freeway

    grid = LaneGrid.of(load_freeway())
    return grid.lanes, grid.cells


def sensor_document() -> dict[str, Any]:
    """The sensor of planners, as plain JSON."""
    text = "Speeds along each lane, in cells of 100 m, m/s: late reports of the segments and pings of connected cars."
    return {"name": STATE, "track": TRACK, **_FIELD, "shape": list(plan_shape()), "description": text}


def control_document() -> dict[str, Any]:
    """The control of planners, as plain JSON."""
    text = "Speeds that connected cars are to drive, by lane and cell, m/s."
    return {"control": PLANNING_CONTROL, **_FIELD, "shape": list(plan_shape()), "description": text}


_FIELD: Final = {"dtype": "float32", "low": 0.0, "high": 45.0}
