"""Families of benchmarks, and the agents that they are for: the control of an agent says what it moves."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum
from typing import Final

from dohyo.sumo_networks.errors import InvalidInputError

PARKING_CONTROL: Final = "torque_steering_brake"
"""Control of agents that park: (3,) shares of motor torque, steering angle and brake torque."""
PLANNING_CONTROL: Final = "target_speeds"
"""Control of planners of freeway mornings: (lanes, cells) of target speeds, m/s."""
FORECASTING_CONTROL: Final = "speeds_ahead"
"""Control of forecasters: (3, N) speeds of N segments in the next three minutes, m/s."""


class Family(StrEnum):
    """Benchmarks that one kind of agent is evaluated on."""

    DRIVING = "driving"
    FREEWAY = "freeway"
    PARKING = "parking"
    FORECASTING = "forecasting"

    @property
    def label(self) -> str:
        """Name of the family in sentences."""
        return "the freeway" if self is Family.FREEWAY else self.value


AGENTS: Final[Mapping[Family, str]] = {
    Family.DRIVING: "agents that drive cars",
    Family.PARKING: f"agents that park karts (control '{PARKING_CONTROL}')",
    Family.FREEWAY: f"planners (control '{PLANNING_CONTROL}')",
    Family.FORECASTING: f"forecasters (control '{FORECASTING_CONTROL}')",
}
_CONTROLS: Final[Mapping[str, Family]] = {
    PARKING_CONTROL: Family.PARKING,
    PLANNING_CONTROL: Family.FREEWAY,
    FORECASTING_CONTROL: Family.FORECASTING,
}


class OtherFamilyError(InvalidInputError):
    """An agent is for benchmarks of another family."""


def family_for(control: str) -> Family:
    """The family of benchmarks that an agent with a control is for."""
    return _CONTROLS.get(control, Family.DRIVING)


def check_family(agent: str, control: str, wanted: Family) -> None:
    """Checks that an agent is for a family of benchmarks.

    Raises:
        OtherFamilyError: It is for another one.
    """
    if family_for(control) != wanted:
        raise OtherFamilyError(f"expected {AGENTS[wanted]}, and '{agent}' has control '{control}'")
