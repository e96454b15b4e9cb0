"""Recording: an agent drives, and sensors, actions and times of its egos are kept.

    order = RecordingRequest(agent="autopilot", sensors=("camera_rgb", "speedometer", "path"), every_s=0.2)
    record_drives({"train": scenarios}, order, Path("data/pictures"))
    Drives(Path("data/pictures"), "train").rows(index)["camera_rgb"]

Everything random follows from the scenarios' seeds: an interrupted recording goes on where it stopped, and the same
order gives the same arrays.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable, Mapping
from contextlib import closing
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, field_validator

from dohyo.agents.driving import decisions
from dohyo.agents.perception.drives import FACTS, Arrays, write_drives
from dohyo.agents.registry import resolve_with
from dohyo.agents.shards import claim_folder
from dohyo.evaluation.agent import agent_info, make_agent
from dohyo.sumo_networks.config import Config
from dohyo.sumo_networks.envs.driving_env import DrivingEnv
from dohyo.sumo_networks.rules.episode_end import reached_goal
from dohyo.sumo_networks.scenario import Scenario
from dohyo.sumo_networks.sensors import BirdseyeConfig, CameraConfig
from dohyo.sumo_networks.units import TICK_S

SCHEMA_VERSION = 1


class RecordingRequest(Config):
    """Order of a recording.

    Attributes:
        agent: Registered name or "module:Class" of the agent that drives every ego.
        settings: Keyword arguments of its constructor.
        sensors: Names or configurations of the sensors that are kept; the agent's own are kept only if named here.
        every_s: Time between two rows of one ego, a multiple of a tick.
        longest_s: Longest drive, at least a tick.
    """

    agent: str = "autopilot"
    settings: Annotated[dict[str, Any], Field(default_factory=dict)]
    sensors: tuple[str | CameraConfig | BirdseyeConfig, ...] = ("camera_rgb", "speedometer")
    every_s: Annotated[float, Field(ge=TICK_S)] = 0.2
    longest_s: Annotated[float, Field(ge=TICK_S)] = 120.0

    @field_validator("every_s")
    @classmethod
    def _whole_ticks(cls, every_s: float) -> float:
        ticks = every_s / TICK_S
        if not math.isclose(ticks, round(ticks)):
            raise ValueError(f"expected a multiple of {TICK_S:g} s, got {every_s:g}")
        return every_s


def record_drives(
    scenarios: Mapping[str, Iterable[Scenario]],
    order: RecordingRequest,
    out: Path,
    progress: Callable[[str], None] = lambda name: None,
) -> int:
    """Records the scenarios that are not there yet.

    Args:
        scenarios: By split ("train", "validation", "test"); their names differ.
        order: What to record.
        out: Folder; see `drives`.
        progress: Called with the name of each scenario that is complete.

    Returns:
        Number of rows of the whole data set.

    Raises:
        InvalidInputError: The folder holds a data set of another order; or an agent, sensor or scenario is impossible.
    """
    claim_folder(out, {"schema": SCHEMA_VERSION, **order.model_dump(mode="json")})
    for split, some in scenarios.items():
        for scenario in some:
            folder = out / split / scenario.name
            if not folder.exists():
                folder.parent.mkdir(parents=True, exist_ok=True)
                write_drives(folder, recorded(scenario, order))
            progress(scenario.name)
    return sum(json.loads(path.read_text())["rows"] for path in out.glob(f"*/[!.]*/*/{FACTS}"))


def recorded(scenario: Scenario, order: RecordingRequest) -> dict[str, tuple[Arrays, dict[str, Any]]]:
    """Drives one scenario.

    Returns:
        Arrays and facts, by ego: the sensors, "action" (T, A) float32 that follows, and "time_s" (T,) float64.

    Raises:
        InvalidInputError: An agent, sensor or network does not exist.
        SimulationError: SUMO failed.
    """
    entry, settings = resolve_with(order.agent, order.settings)
    egos = [mission.name for mission in scenario.missions]
    agents = {ego: make_agent(entry, settings) for ego in egos}
    spec = agents[egos[0]].spec
    kept = [sensor if isinstance(sensor, str) else sensor.name for sensor in order.sensors]
    sensors = tuple(dict.fromkeys((*order.sensors, *spec.sensors)))
    stride = max(round(order.every_s / TICK_S), 1)
    rows: dict[str, list[tuple[Any, ...]]] = {ego: [] for ego in egos}
    with closing(DrivingEnv(scenario, sensors, spec.control, reward=None)) as env:
        for now in decisions(env, agents, round(order.longest_s / TICK_S)):
            if now.tick % stride == 0:
                for ego, action in now.actions.items():
                    seen = (now.observations[ego][name] for name in kept)
                    rows[ego].append((*seen, np.asarray(action, dtype=np.float32), now.tick * TICK_S))
        success = [reached_goal(env.world, ego) for ego in range(len(egos))]
    facts = {
        "agent": agent_info(agents[egos[0]], entry, settings).model_dump(mode="json"),
        "network": scenario.network,
        "scenario": scenario.name,
        "seed": scenario.seed,
        "every_s": stride * TICK_S,
    }
    names = (*kept, "action", "time_s")
    return {ego: (_columns(names, rows[ego]), facts | {"success": success[i]}) for i, ego in enumerate(egos)}


def _columns(names: tuple[str, ...], rows: list[tuple[Any, ...]]) -> dict[str, NDArray[Any]]:
    return {name: np.stack(column) for name, column in zip(names, zip(*rows, strict=True), strict=True)}
