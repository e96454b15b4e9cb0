"""dohyo evaluates driving agents in SUMO traffic.

This module exports the most common names, and imports each at its first use, so that `import dohyo` is quick. It also
registers `dohyo/Driving-v0`, `dohyo/Quickstart-v0` and other ids for `gymnasium.make`, and has numba compile a kernel
again whenever anything changes that it was compiled from.

The four floors are `dohyo.sumo_networks` (the world), `dohyo.evaluation` (criteria, scores, benchmarks),
`dohyo.agents` (the policies and their training) and `dohyo.service` (REST, policy workers, dashboard, command line).
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from dohyo.gym_ids import register_all
from dohyo.once_imported import once_imported

if TYPE_CHECKING:
    from dohyo.agents.evaluation import evaluate
    from dohyo.evaluation.agent import Agent
    from dohyo.evaluation.benchmarks.environments import make_vec
    from dohyo.service.client.remote_env import RemoteEnv
    from dohyo.sumo_networks.envs.driving_env import DrivingEnv
    from dohyo.sumo_networks.networks.catalog import load_network
    from dohyo.sumo_networks.scenario import Scenario

__all__ = ["Agent", "DrivingEnv", "RemoteEnv", "Scenario", "evaluate", "load_network", "make_vec"]

_HOMES = {
    "Agent": "dohyo.evaluation.agent",
    "DrivingEnv": "dohyo.sumo_networks.envs.driving_env",
    "RemoteEnv": "dohyo.service.client.remote_env",
    "Scenario": "dohyo.sumo_networks.scenario",
    "evaluate": "dohyo.agents.evaluation",
    "load_network": "dohyo.sumo_networks.networks.catalog",
    "make_vec": "dohyo.evaluation.benchmarks.environments",
}


def _keep_kernels_up_to_date() -> None:
    import_module("dohyo.kernel_cache").install()


once_imported("gymnasium.envs.registration", register_all)
once_imported("numba.core.caching", _keep_kernels_up_to_date)


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'dohyo' has no attribute '{name}' (there is {', '.join(__all__)})")
    value = getattr(import_module(_HOMES[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
