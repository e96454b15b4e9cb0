"""ParkingAgent: the interface of every policy that parks a kart."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal, Protocol

from pydantic import ValidationError

from dohyo.evaluation.entry import make_entry
from dohyo.evaluation.families import PARKING_CONTROL, Family, check_family
from dohyo.sumo_networks.arrays import Float32Array
from dohyo.sumo_networks.config import Config
from dohyo.sumo_networks.errors import AgentError, InvalidInputError
from dohyo.sumo_networks.parking.observation import State
from dohyo.sumo_networks.parking.rows import LotView


class ParkingSpec(Config):
    """Name, track and observation of an agent.

    Attributes:
        name: Name of the agent, for people and file names.
        track: "privileged" if the agent also sees the whole lot, see `ParkingAgent.look`.
        state: Columns of the observation beside the radar, see `dohyo.sumo_networks.parking.observation`.
    """

    name: str
    track: Literal["sensors", "privileged"] = "sensors"
    state: State = "oriented"

    @property
    def sensors(self) -> tuple[str, ...]:
        """What the agent observes, for records."""
        return (f"parking-{self.state}",)

    @property
    def control(self) -> str:
        """What the agent controls, for records."""
        return PARKING_CONTROL


class ParkingAgent(Protocol):
    """A policy that parks one kart; each kart of a lot has an agent of its own.

    Attributes:
        spec: Specification of the agent, known before the first episode.
    """

    spec: ParkingSpec

    def reset(self, seed: int) -> None:
        """Prepares for an episode; all randomness must follow from the seed."""

    def act(self, observation: Float32Array) -> Float32Array:
        """Decides once per tick of 0.1 s.

        Args:
            observation: Columns of the spec's state and of the radar, see `dohyo.sumo_networks.parking.observation`.

        Returns:
            (3,) shares of motor torque, steering angle and brake torque, in [-1, 1].
        """
        ...

    def look(self, lot: LotView, number: int) -> None:
        """Shows a privileged agent the lot and the number of its kart, before each decision.

        The arrays of the lot are read-only copies.
        """

    def close(self) -> None:
        """Frees the resources of the agent."""


class FailedAgent:
    """Stands for an agent that has failed already, such as one whose process was ended: it fails at once.

    Attributes:
        spec: A specification; it observes nothing.
    """

    spec = ParkingSpec(name="failed")

    def __init__(self, why: str) -> None:
        """Stores the reason, for the record."""
        self._why = why

    def reset(self, seed: int) -> None:
        """Raises AgentError."""
        raise AgentError(self._why)

    def act(self, observation: Float32Array) -> Float32Array:
        """Raises AgentError."""
        raise AgentError(self._why)

    def look(self, lot: LotView, number: int) -> None:
        """Sees nothing."""

    def close(self) -> None:
        """Does nothing: it holds no resources."""


def make_parking_agent(entry: str, settings: Mapping[str, Any] | None = None) -> ParkingAgent:
    """Makes an agent from "module:Class" and the keyword arguments of its constructor.

    Raises:
        InvalidInputError: The module or class is missing, its constructor fails, or it is no agent that parks.
        OtherFamilyError: It drives cars.
        SettingsError: Settings are unknown, of another type, or out of range.
    """
    agent: ParkingAgent = make_entry(entry, "agent", settings or {})
    missing = [name for name in ("spec", "reset", "act") if not hasattr(agent, name)]
    if missing:
        where = "see dohyo.evaluation.parking.agent.ParkingAgent"
        raise InvalidInputError(f"agent '{entry}' has no {', '.join(missing)} ({where})")
    if not hasattr(agent.spec, "state"):
        check_family(str(getattr(agent.spec, "name", entry)), str(getattr(agent.spec, "control", "")), Family.PARKING)
        raise InvalidInputError(f"agent '{entry}' cannot park: expected a ParkingSpec, got {type(agent.spec).__name__}")
    try:
        ParkingSpec.model_validate(agent.spec, from_attributes=True)
    except ValidationError as error:
        raise InvalidInputError(f"agent '{entry}' cannot park: spec: {error.errors()[0]['msg']}") from error
    if agent.spec.track == "privileged" and not hasattr(agent, "look"):
        raise InvalidInputError(f"agent '{entry}' has no look, which its track 'privileged' needs")
    return agent
