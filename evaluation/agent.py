"""Agent: the interface of every policy, and the function that makes one from its entry."""

from __future__ import annotations

import hashlib
import traceback
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MethodType
from typing import Any, Final, Literal, Protocol

import numpy as np
from pydantic import ValidationError

from dohyo.evaluation.agent_files import files_of, parts_of
from dohyo.evaluation.entry import make_entry
from dohyo.evaluation.families import Family, check_family
from dohyo.evaluation.records.record import AgentInfo, Kind
from dohyo.evaluation.sources import source_files
from dohyo.sumo_networks.ego.control import CONTROLS
from dohyo.sumo_networks.errors import InvalidInputError, UnknownNameError
from dohyo.sumo_networks.scenario import Config, Mission
from dohyo.sumo_networks.sensors import Observation, Track, make_sensors

__all__ = [
    "Agent", "AgentSpec", "Explanation", "Mission", "Observation",
    "agent_info", "close_agent", "make_agent", "source_digest",
]  # fmt: skip

Explanation = dict[str, Any]
_OPTIONAL: Final = ("warm_up", "explain", "close")


class AgentSpec(Config):
    """Name, track, sensors and control of an agent.

    Attributes:
        name: Name of the agent, for people and file names.
        track: Track, which limits the sensors that the agent may use.
        sensors: Names of the sensors that the agent reads, of `dohyo.sumo_networks.sensors.SENSORS`.
        control: Name of the control interface, of `dohyo.sumo_networks.ego.control.CONTROLS`.
    """

    name: str
    track: Literal["sensors", "map", "privileged"] = "map"
    sensors: tuple[str, ...] = ("speedometer", "route")
    control: str = "target_speed_steering"


class Agent(Protocol):
    """A policy that drives one ego; it needs `spec`, `reset` and `act`. Any class that has them will do.

    Attributes:
        spec: Specification of the agent, known before the first episode.
    """

    spec: AgentSpec

    def warm_up(self) -> None:
        """Compiles and loads what decisions call, on made-up input; a call of `reset` follows.

        It is called before each episode, with a deadline of minutes, so that no decision waits for a compiler.
        """
        return

    def reset(self, mission: Mission, seed: int) -> None:
        """Prepares for an episode; all randomness must follow from the seed."""

    def act(self, observation: Observation) -> np.ndarray:
        """Decides once per tick, 10 times per simulated second.

        Args:
            observation: One array per sensor of the spec: float32, of pictures uint8.

        Returns:
            Action in the space of the control interface.
        """
        ...

    def explain(self) -> Explanation | None:
        """Explanation of the last decision as plain JSON; None if the agent has none."""
        return None

    def close(self) -> None:
        """Frees the resources of the agent."""


def make_agent(entry: str, settings: Mapping[str, Any] | None = None) -> Agent:
    """Makes an agent from "module:Class" and the keyword arguments of its constructor.

    One that lacks an optional method gets that of `Agent`.

    Raises:
        InvalidInputError: The module or class is missing, its constructor fails, or its spec is impossible.
        OtherFamilyError: It does not drive cars.
        SettingsError: Settings are unknown, of another type, or out of range.
    """
    agent: Agent = make_entry(entry, "agent", settings or {})
    _check(agent, entry)
    _complete(agent, entry)
    return agent


def close_agent(agent: Agent) -> None:
    """Frees an agent's resources; what it was made for is over, so that a failure here is printed and loses nothing."""
    try:
        agent.close()
    except (Exception, SystemExit):
        traceback.print_exc()


def agent_info(agent: Agent, entry: str, settings: Mapping[str, Any] | None = None, kind: Kind = "local") -> AgentInfo:
    """Description of an agent for records.

    Raises:
        InvalidInputError: A file that it names as its own is missing or cannot be read.
    """
    # The sources of an agent that wraps others include theirs, and all files that any of them names as its own.
    parts = parts_of(agent)
    files = files_of(parts)
    return AgentInfo(
        name=agent.spec.name,
        kind=kind,
        entry=entry,
        source_sha256=source_digest([type(part) for part in parts]),
        files_sha256=_files_digest(files, agent.spec.name) if files else "",
        track=agent.spec.track,
        sensors=agent.spec.sensors,
        control=agent.spec.control,
        settings=dict(settings or {}),
    )


def source_digest(classes: Sequence[type]) -> str:
    """Hash of the source files of an agent's class and of the classes of the agents that it wraps."""
    try:
        return _digest([file for one in classes for file in source_files(one)])
    except (TypeError, OSError):  # a class without a file, such as one that was defined at a prompt
        return _digest([])


def _files_digest(files: Sequence[Path], agent: str) -> str:
    """Hash of the files that an agent names as its own, all of which must be there."""
    try:
        return _digest(files)
    except OSError as error:
        raise InvalidInputError(
            f"agent '{agent}': files: cannot read '{error.filename}': {error.strerror}; a record states their hash"
        ) from error


def _digest(files: Sequence[Path]) -> str:
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()


def _check(agent: Agent, entry: str) -> None:
    """Checks the specification of an agent before any simulation."""
    missing = [name for name in ("spec", "reset", "act") if not hasattr(agent, name)]
    if missing:
        raise InvalidInputError(f"agent '{entry}' has no {', '.join(missing)} (see dohyo.evaluation.agent.Agent)")
    if isinstance(agent.spec, Mapping):
        raise InvalidInputError(f"agent '{entry}': spec: expected an AgentSpec, got {type(agent.spec).__name__}")
    try:
        spec = AgentSpec.model_validate(agent.spec, from_attributes=True)
    except ValidationError as error:
        raise InvalidInputError(f"agent '{entry}': spec: {error.errors()[0]['msg']}") from error
    check_family(spec.name, spec.control, Family.DRIVING)
    make_sensors(spec.sensors, Track[spec.track.upper()])
    if spec.control not in CONTROLS:
        raise UnknownNameError("control", spec.control, CONTROLS)


def _complete(agent: Agent, entry: str) -> None:
    """Gives an agent of a class without a base the optional methods that it lacks."""
    for name in _OPTIONAL:
        if hasattr(agent, name):
            continue
        try:
            setattr(agent, name, MethodType(getattr(Agent, name), agent))
        except AttributeError as error:  # slots, or a frozen dataclass
            raise InvalidInputError(
                f"agent '{entry}' has no {name}, and has no room for one; derive it from dohyo.evaluation.agent.Agent"
            ) from error
