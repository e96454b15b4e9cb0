"""The environments that `gymnasium.make` knows once dohyo is imported."""

from __future__ import annotations

from gymnasium.envs.registration import register, registry

SINGLE = "dohyo.evaluation.benchmarks.environments:make_env"
VECTOR = "dohyo.evaluation.benchmarks.environments:make_vec"

BENCHMARKS = {"Quickstart": "quickstart", "NoCrash": "nocrash", "Leaderboard": "leaderboard-train"}
"""Benchmark by the name of its environment; `dohyo/Driving-v0` takes scenarios or a network with missions."""


def register_all() -> None:
    """Adds `dohyo/Driving-v0` and one id per benchmark to gymnasium's registry; existing ids stay."""
    for name, benchmark in {"Driving": None, **BENCHMARKS}.items():
        if f"dohyo/{name}-v0" not in registry:
            kwargs = {"source": benchmark} if benchmark else {}
            register(f"dohyo/{name}-v0", entry_point=SINGLE, vector_entry_point=VECTOR, kwargs=kwargs)
