"""Agent: the one interface every policy fulfils, and how one is made from its name."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal, Protocol

import numpy as np
from pydantic import ValidationError

from dohyo.evaluation.entry import make_entry
from dohyo.evaluation.records.record import AgentInfo
from dohyo.evaluation.sources import source_files
from dohyo.sumo_networks.ego.control import CONTROLS
from dohyo.sumo_networks.envs.driving_env import Observation
from dohyo.sumo_networks.errors import InvalidInputError, UnknownNameError
from dohyo.sumo_networks.scenario import Config, Mission
from dohyo.sumo_networks.sensors import Track, make_sensors

__all__ = ["Agent", "AgentSpec", "Explanation", "Mission", "Observation", "agent_info", "make_agent"]

Explanation = dict[str, Any]


class AgentSpec(Config):
    """What an agent is, sees and does.

    Attributes:
        name: For people and file names.
        track: Which sensors it may use.
        sensors: What it sees, names of `dohyo.sumo_networks.sensors.SENSORS`.
        control: How it acts, a name of `dohyo.sumo_networks.ego.control.CONTROLS`.
    """

    name: str
    track: Literal["sensors", "map", "privileged"] = "map"
    sensors: tuple[str, ...] = ("speedometer", "route")
    control: str = "target_speed_steering"


class Agent(Protocol):
    """A policy that drives one ego. Inherit from it to get the optional methods.

    Attributes:
        spec: Known before the first episode.
    """

    spec: AgentSpec

    def warm_up(self) -> None:
        """Compiles and loads what decisions call, on made-up input; a call of `reset` follows.

        It is called before each episode, with a deadline of minutes, so that no decision waits for a compiler.
        """
        return

    def reset(self, mission: Mission, seed: int) -> None:
        """Prepares for an episode; everything random must follow from the seed."""

    def act(self, observation: Observation) -> np.ndarray:
        """One decision, 10 times a simulated second.

        Args:
            observation: One float32 array per sensor of the spec.

        Returns:
            An action of the control interface's space.
        """
        ...

    def explain(self) -> Explanation | None:
        """Why the last decision was taken, as plain JSON; None where the agent has nothing to say."""
        return None

    def close(self) -> None:
        """Frees what the agent holds."""


def make_agent(entry: str, settings: Mapping[str, Any] | None = None) -> Agent:
    """Makes an agent from "module:Class" and the keyword arguments of its constructor.

    Raises:
        InvalidInputError: The module or class is missing, a setting is unknown, its constructor fails, or its spec is
            impossible.
    """
    agent: Agent = make_entry(entry, "agent", settings or {})
    _check(agent, entry)
    return agent


def agent_info(agent: Agent, entry: str, settings: Mapping[str, Any] | None = None) -> AgentInfo:
    """What a record says of an agent."""
    # An agent that wraps others is made of all their sources, and of the files that any of them calls its own.
    parts = [agent]
    while (inner := getattr(parts[-1], "inner", None)) is not None:
        parts.append(inner)
    try:
        files = [file for part in parts for file in (*source_files(type(part)), *getattr(part, "files", ()))]
        source = b"".join(Path(file).read_bytes() for file in files)
    except (TypeError, OSError):
        source = b""
    return AgentInfo(
        name=agent.spec.name,
        entry=entry,
        source_sha256=hashlib.sha256(source).hexdigest(),
        track=agent.spec.track,
        sensors=agent.spec.sensors,
        control=agent.spec.control,
        settings=dict(settings or {}),
    )


def _check(agent: Agent, entry: str) -> None:
    """Refuses an agent before it costs any simulation."""
    missing = [name for name in ("spec", "reset", "act") if not hasattr(agent, name)]
    if missing:
        raise InvalidInputError(f"agent '{entry}' has no {', '.join(missing)} (see dohyo.evaluation.agent.Agent)")
    try:
        spec = AgentSpec.model_validate(agent.spec, from_attributes=True)
    except ValidationError as error:
        raise InvalidInputError(f"agent '{entry}': spec: {error.errors()[0]['msg']}") from error
    make_sensors(spec.sensors, Track[spec.track.upper()])
    if spec.control not in CONTROLS:
        raise UnknownNameError("control", spec.control, CONTROLS)
