"""evaluate: one agent on one benchmark, from Python; `dohyo evaluate` does the same from the command line."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from dohyo.agents.registry import kind_of, resolve_with
from dohyo.evaluation.agent import Agent
from dohyo.evaluation.benchmarks.benchmark import Benchmark, load_benchmark
from dohyo.evaluation.running.executors import ProcessPool
from dohyo.evaluation.running.run import Result, run_benchmark
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.processes import end_unguarded
from dohyo.sumo_networks.seeds import episode_seeds


def evaluate(
    agent: str | Callable[..., Agent],
    benchmark: str | Benchmark = "quickstart",
    *,
    seeds: Sequence[int] | None = None,
    only: Sequence[str] = (),
    sample: int | None = None,
    out: str | Path | None = None,
    workers: int = 1,
    settings: Mapping[str, Any] | None = None,
) -> Result:
    """Drives every scenario of a benchmark and keeps one record of each; run again, it does only what is missing.

    Args:
        agent: A registered name, "module:Class", a class of agents, or a function that makes one. Worker processes
            import it again, so it must stand at the top of a module; a script needs `if __name__ == "__main__":`.
        benchmark: Its name, the path of a .toml file, or the benchmark itself.
        seeds: Whole numbers from 0 to 2^31 - 1, each once; by default the benchmark's own.
        only: Names or patterns of the cells and missions to drive; empty: all.
        sample: Number of missions to draw from those; None: all.
        out: Folder of the results; by default out/BENCHMARK/AGENT.
        workers: How many processes drive.
        settings: Keyword arguments that make the agent.

    Raises:
        InvalidInputError: An argument of another form, an unknown name, an agent that cannot be made or imported, a
            mission that cannot be driven, or a folder that holds another evaluation. Nothing has been driven then. Or
            a script without that guard.
    """
    end_unguarded()
    _check_counts(workers, sample)
    _check_names(only)
    if isinstance(benchmark, str):
        benchmark = load_benchmark(benchmark)
    if not isinstance(benchmark, Benchmark):
        raise InvalidInputError(
            f"benchmark: expected a name, the path of a .toml file or a Benchmark, got {type(benchmark).__name__}"
        )
    name = agent if isinstance(agent, str) else _entry(agent)
    entry, made_with = resolve_with(name, settings or {})
    folder = Path("out") / benchmark.name / re.sub(r"[^\w.-]", "_", name)
    return run_benchmark(
        benchmark,
        entry,
        settings=made_with,
        kind=kind_of(entry, made_with),
        seeds=None if seeds is None else _checked_seeds(seeds),
        only=only,
        sample=sample,
        out=folder if out is None else Path(out),
        executor=ProcessPool(workers),
    )


def _check_counts(workers: object, sample: object) -> None:
    for name, number in (("workers", workers), ("sample", 1 if sample is None else sample)):
        if isinstance(number, bool) or not isinstance(number, int) or number < 1:
            raise InvalidInputError(f"{name}: expected at least 1, a whole number, got {number!r}")


def _check_names(only: object) -> None:
    if isinstance(only, str) or not isinstance(only, Sequence) or not all(isinstance(name, str) for name in only):
        raise InvalidInputError(f"only: expected a list of names or patterns of cells and missions, got {only!r}")


def _checked_seeds(seeds: object) -> list[int]:
    try:
        checked = episode_seeds(seeds)
    except InvalidInputError as error:
        raise InvalidInputError(f"seeds: {error}") from error
    if not checked:
        raise InvalidInputError("seeds: expected at least one, got none")
    return checked


def _entry(maker: Callable[..., Agent]) -> str:
    """The "module:name" of a class or function."""
    module, name = getattr(maker, "__module__", None), getattr(maker, "__qualname__", "")
    if not module or not name.isidentifier():
        raise InvalidInputError(
            f"agent {maker!r}: expected a class or function at the top of a module, since worker processes import it"
        )
    return f"{module}:{name}"
