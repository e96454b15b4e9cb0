"""Warm-up: no decision of an episode waits for the compiler."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numba.core.dispatcher import Dispatcher

from dohyo.agents.registry import resolve_with
from dohyo.evaluation.agent import Agent, Mission, Observation, make_agent
from dohyo.evaluation.episode.runner import drive_episode
from dohyo.sumo_networks.processes import worker_pool
from tests.evaluation.episode.test_runner import scenario

PRELOADED = "dohyo.sumo_networks.preloaded"

AGENTS: dict[str, dict[str, Any]] = {
    "autopilot, es-ekf": {"localization": "es-ekf"},
    "autopilot, ekf": {"localization": "ekf"},
    "autopilot, ukf": {"localization": "ukf"},
    "autopilot, shield": {"shield": "rss"},
    "ghrl": {},
    "rules": {},
    "idm": {},
    "pdm-closed": {},
    "mbappe": {},
}


class Watched(Agent):
    """Notes the kernels that its agent loads while it decides."""

    def __init__(self, agent: Agent) -> None:
        self.agent, self.spec = agent, agent.spec
        self.late: set[str] = set()

    def warm_up(self) -> None:
        self.agent.warm_up()

    def reset(self, mission: Mission, seed: int) -> None:
        self.agent.reset(mission, seed)

    def act(self, observation: Observation) -> np.ndarray:
        before = kernels()
        try:
            return self.agent.act(observation)
        finally:  # the compiler may take longer than a decision may
            self.late |= kernels() - before


def kernels() -> set[str]:
    """Kernels of dohyo that this process has compiled or loaded."""
    return {
        f"{module}.{name} {signature}"
        for module, content in list(sys.modules.items())
        if module.startswith("dohyo.") and module != PRELOADED
        for name, value in list(vars(content).items())
        if isinstance(value, Dispatcher)
        for signature in value.signatures
    }


def compiled_while_deciding(name: str, settings: Mapping[str, Any]) -> tuple[int, int, list[str], str | None]:
    """Kernels before the agent is made, those at the end, names of those that a decision needed first; its failure."""
    before = len(kernels())
    agent = Watched(make_agent(*resolve_with(name, settings)))
    record, _ = drive_episode(scenario(time_limit_s=8.0), {"ego": agent})
    return before, len(kernels()), sorted(agent.late), record.egos[0].failure


def python(code: str, *arguments: str, **environment: str) -> str:
    """Output of a Python process of its own, in which nothing has been compiled yet."""
    command = [sys.executable, "-c", code, *arguments]
    done = subprocess.run(command, env=os.environ | environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()[-1]


@pytest.mark.parametrize(
    "agent", [name if "es-ekf" in name else pytest.param(name, marks=pytest.mark.slow) for name in AGENTS]
)
def test_no_decision_of_an_episode_compiles_a_kernel(agent: str) -> None:
    with worker_pool(1, compiled_while_deciding) as pool:  # a process in which nothing has been compiled yet
        before, count, late, failure = pool.submit(compiled_while_deciding, agent.split(",")[0], AGENTS[agent]).result()
    assert before == 0
    assert count > 10
    assert late == []
    assert failure is None, "it made all its decisions"


DRIVES = """
from tests.agents.test_warm_up import compiled_while_deciding

print(*compiled_while_deciding("autopilot", {})[2:])
"""


@pytest.mark.slow
def test_with_an_empty_cache_the_first_episode_has_no_late_decision(tmp_path: Path) -> None:
    assert python(DRIVES, NUMBA_CACHE_DIR=str(tmp_path)) == "[] None"
    assert list(tmp_path.rglob("*.nbi")), "nothing was compiled into this cache"
