"""Evaluations by agent: result folders as reports compare them, a mixed run as one evaluation per agent."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from dohyo.evaluation.records.mixed import agents_of, drives_of
from dohyo.evaluation.records.record import AgentInfo, EpisodeRecord
from dohyo.evaluation.report.contenders import Evaluation
from dohyo.evaluation.running.run import Result


def evaluations_of(results: Sequence[Result]) -> list[Evaluation]:
    """One evaluation per result folder, and one per agent of all mixed runs together.

    Mixed runs in which agents have exchanged their missions give drives that can be compared. Agents with equal names
    and settings, such as one before and after a change of its code, have the names of their folders as well.
    """
    single = [result for result in results if not result.manifest.others]
    mixed = [result for result in results if result.manifest.others]
    found = [(result.manifest.agent, [result]) for result in single]
    found += [(agent, mixed) for agent in agents_of(record for result in mixed for record in result.records)]
    names = unique_names([agent for agent, _ in found])
    names = [
        _with_folders(name, some) if names.count(name) > 1 else name
        for name, (_, some) in zip(names, found, strict=True)
    ]
    return [_evaluation(name, agent, some) for name, (agent, some) in zip(names, found, strict=True)]


def unique_names(agents: Sequence[AgentInfo]) -> list[str]:
    """Names of agents; with settings, if one agent was evaluated under several."""
    names = [agent.name for agent in agents]
    settings = [" ".join(f"{key}={value}" for key, value in agent.settings.items()) for agent in agents]
    return [
        f"{name} ({setting})" if setting and names.count(name) > 1 else name
        for name, setting in zip(names, settings, strict=True)
    ]


def _with_folders(name: str, results: Sequence[Result]) -> str:
    """Name of an agent with those of its result folders, which alone distinguish versions of its code."""
    return f"{name} ({', '.join(result.paths[0].resolve().parents[1].name for result in results)})"


def _evaluation(name: str, agent: AgentInfo, results: Sequence[Result]) -> Evaluation:
    manifest = results[0].manifest
    drives = list(_drives(agent, results))
    return Evaluation(
        agent=name,
        benchmark=manifest.benchmark.name,
        benchmark_hash=manifest.benchmark_sha256,
        records=tuple(record for record, _ in drives),
        record_paths=tuple(path for _, path in drives),
        headline=manifest.benchmark.headline,
        metric=manifest.benchmark.metric,
        part="; ".join(dict.fromkeys(result.part for result in results if result.part)),
    )


def _drives(agent: AgentInfo, results: Sequence[Result]) -> Iterator[tuple[EpisodeRecord, Path]]:
    for result in results:
        for record, path in zip(result.records, result.paths, strict=True):
            narrowed = drives_of(agent, record) if result.manifest.others else record
            if narrowed is not None:
                yield narrowed, path
