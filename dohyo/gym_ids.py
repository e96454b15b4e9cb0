"""The environments that `gymnasium.make` knows once dohyo is imported, without importing gymnasium itself: 0.2 s."""

from __future__ import annotations

SINGLE = "dohyo.evaluation.benchmarks.environments:make_env"
REMOTE = "dohyo.service.client.remote_env:RemoteEnv"
VECTOR = "dohyo.evaluation.benchmarks.environments:make_vec"

BENCHMARKS = {"Quickstart": "quickstart", "NoCrash": "nocrash", "Leaderboard": "leaderboard-train"}
"""Benchmark by the name of its environment; `dohyo/Driving-v0` takes scenarios or a network with missions."""


def register_all() -> None:
    """Adds `dohyo/Driving-v0`, `dohyo/Remote-v0` and an id per benchmark to gymnasium's registry; others stay."""
    from gymnasium.envs.registration import register, registry

    for name, benchmark in {"Driving": None, **BENCHMARKS}.items():
        if f"dohyo/{name}-v0" not in registry:
            kwargs = {"source": benchmark} if benchmark else {}
            register(f"dohyo/{name}-v0", entry_point=SINGLE, vector_entry_point=VECTOR, kwargs=kwargs)
    if "dohyo/Remote-v0" not in registry:
        register("dohyo/Remote-v0", vector_entry_point=REMOTE)
