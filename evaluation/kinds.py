"""Kinds of benchmarks, and the agents that they are for: the control of an agent says what it moves."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, Literal

from dohyo.sumo_networks.errors import InvalidInputError

BenchmarkKind = Literal["driving", "parking", "freeway"]

PARKING_CONTROL: Final = "torque_steering_brake"
"""Control of agents that park: (3,) shares of motor torque, steering angle and brake torque."""
PLANNING_CONTROL: Final = "target_speeds"
"""Control of planners of freeway mornings: (lanes, cells) of target speeds, m/s."""

AGENTS: Final[Mapping[BenchmarkKind, str]] = {
    "driving": "agents that drive cars",
    "parking": f"agents that park karts (control '{PARKING_CONTROL}')",
    "freeway": f"planners (control '{PLANNING_CONTROL}')",
}


class OtherKindError(InvalidInputError):
    """An agent is for another kind of benchmark."""


def kind_for(control: str) -> BenchmarkKind:
    """The kind of benchmark that an agent with a control is for."""
    kinds: dict[str, BenchmarkKind] = {PARKING_CONTROL: "parking", PLANNING_CONTROL: "freeway"}
    return kinds.get(control, "driving")


def check_kind(agent: str, control: str, wanted: BenchmarkKind) -> None:
    """Checks that an agent is for a kind of benchmark.

    Raises:
        OtherKindError: It is for another one.
    """
    if kind_for(control) != wanted:
        raise OtherKindError(f"expected {AGENTS[wanted]}, and '{agent}' has control '{control}'")
