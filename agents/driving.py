"""Driving for recordings: agents drive a scenario's egos, tick by tick."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from numpy.typing import NDArray

from dohyo.evaluation.agent import Agent
from dohyo.sumo_networks.envs.driving_env import DrivingEnv
from dohyo.sumo_networks.sensors import Observation


@dataclass(frozen=True, slots=True)
class Decisions:
    """One tick of all egos that drive.

    Attributes:
        tick: Number of ticks before it.
        observations: By ego.
        actions: Actions that follow, by ego; a recording may change them before the tick goes on.
    """

    tick: int
    observations: Mapping[str, Observation]
    actions: dict[str, NDArray[Any]]


def decisions(env: DrivingEnv, agents: Mapping[str, Agent], ticks: int) -> Iterator[Decisions]:
    """Drives until nobody drives any more, or the ticks are over; the caller closes the environment.

    Each item comes before its tick: `env.world` is what the observations show. The last one has no actions where all
    egos have ended.

    Args:
        env: Not started.
        agents: By the names of the scenario's missions.
        ticks: Most ticks.

    Raises:
        DohyoError: The simulation or an agent failed.
    """
    observations, _ = env.reset()
    for mission in env.scenario.missions:
        agents[mission.name].reset(mission, env.scenario.seed)
    for tick in range(ticks):
        now = Decisions(tick, observations, {name: agents[name].act(observations[name]) for name in env.agents})
        yield now
        if not env.agents:
            return
        observations, *_ = env.step(now.actions)
