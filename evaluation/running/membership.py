"""Membership: whether a record is of the benchmark that it names, not of an easier one, and of the folder's agents."""

from __future__ import annotations

from collections.abc import Iterable
from importlib.metadata import version
from pathlib import Path

from dohyo.evaluation.benchmarks.benchmark import Benchmark, load_benchmark
from dohyo.evaluation.benchmarks.documents import benchmark_names
from dohyo.evaluation.families import Family
from dohyo.evaluation.records.record import AgentInfo, EpisodeRecord
from dohyo.evaluation.running.manifest import Manifest, manifest_of_record
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.scenario import Scenario


def check_members(records: Iterable[tuple[EpisodeRecord, Path]], benchmark: Benchmark, sha256: str) -> None:
    """Checks that records are of a benchmark: each names its version, and drove one of its scenarios.

    Args:
        records: Records, each with its path.
        benchmark: Benchmark.
        sha256: Its content hash.

    Raises:
        InvalidInputError: A record names another benchmark, or its scenario is not that of the benchmark.
    """
    made: dict[int, dict[str, Scenario]] = {}
    for record, path in records:
        _check_label(record, path, benchmark, sha256)
        seed = 0 if benchmark.excerpts else record.scenario.seed  # missions with an excerpt have their own seeds
        if seed not in made:
            made[seed] = {one.name: one for one in benchmark.scenarios([seed])}
        _check_scenario(record, path, made[seed], f"{benchmark.name} {sha256[:8]}")


def check_agents(records: Iterable[tuple[EpisodeRecord, Path]], manifest: Manifest) -> None:
    """Checks that the agents of a result folder drove its records.

    Args:
        records: Records, each with its path.
        manifest: Manifest of the folder.

    Raises:
        InvalidInputError: Another agent drove an ego, or the same one with other settings or code.
    """
    for record, path in records:
        for ego in record.egos:
            expected = manifest.agent_of(ego.name)
            if ego.agent == expected:
                continue
            names = [name for name in AgentInfo.model_fields if getattr(ego.agent, name) != getattr(expected, name)]
            raise InvalidInputError(
                f"{path}: expected '{ego.name}' driven by agent {expected.name!r:.60}, "
                f"got agent {ego.agent.name!r:.60} with other {', '.join(names)}"
            )


def benchmark_of_record(record: EpisodeRecord, path: Path) -> Benchmark | None:
    """Benchmark that a record names, from the manifest of its result folder or from the catalog; None: unknown here.

    Raises:
        InvalidInputError: It lies in the result folder of another benchmark.
    """
    if (manifest := manifest_of_record(path)) is not None:
        _check_label(record, path, manifest.benchmark, manifest.benchmark_sha256)
        return manifest.benchmark
    # The record's author chose the name: it must not be a path.
    if record.benchmark is None or record.benchmark[0] not in benchmark_names(Family.DRIVING):
        return None
    found = load_benchmark(record.benchmark[0])
    return found if found.sha256 == record.benchmark[1] else None


def _check_label(record: EpisodeRecord, path: Path, benchmark: Benchmark, sha256: str) -> None:
    named = record.benchmark
    if named is None or named[1] != sha256:
        got = "one of no benchmark" if named is None else f"one of {named[0]!r:.60} {named[1][:8]!r}"
        raise InvalidInputError(f"{path}: expected a record of benchmark {benchmark.name} {sha256[:8]}, got {got}")


def _check_scenario(record: EpisodeRecord, path: Path, scenarios: dict[str, Scenario], benchmark: str) -> None:
    got = record.scenario
    expected = scenarios.get(got.name)
    if expected is None:
        raise InvalidInputError(f"{path}: expected a scenario of benchmark {benchmark}, got '{got.name}'")
    if got == expected:
        return
    others = [name for name in Scenario.model_fields if getattr(got, name) != getattr(expected, name)]
    here, there = version("dohyo"), record.versions.dohyo
    older = "" if here == there else f" (the record is of dohyo {there:.20}, this is {here})"
    raise InvalidInputError(
        f"{path}: expected scenario '{got.name}' with seed {expected.seed} as benchmark {benchmark} has it, got one "
        f"with other {', '.join(others)}{older}"
    )
