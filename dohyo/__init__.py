"""dohyo evaluates driving agents in SUMO traffic.

The names here are those that most people start with; each is imported when it is first used, so that `import dohyo`
is quick. The four floors are `dohyo.sumo_networks` (the world), `dohyo.evaluation` (criteria, scores, benchmarks),
`dohyo.agents` (the policies and their training) and `dohyo.service` (REST, policy workers, dashboard, command line).
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dohyo.evaluation.agent import Agent
    from dohyo.sumo_networks.envs.driving_env import DrivingEnv
    from dohyo.sumo_networks.networks.catalog import load_network
    from dohyo.sumo_networks.scenario import Scenario

__all__ = ["Agent", "DrivingEnv", "Scenario", "load_network"]

_HOMES = {
    "Agent": "dohyo.evaluation.agent",
    "DrivingEnv": "dohyo.sumo_networks.envs.driving_env",
    "Scenario": "dohyo.sumo_networks.scenario",
    "load_network": "dohyo.sumo_networks.networks.catalog",
}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'dohyo' has no attribute '{name}' (there is {', '.join(__all__)})")
    value = getattr(import_module(_HOMES[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
