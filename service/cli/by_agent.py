"""Evaluations by agent: result folders as reports compare them, a mixed run as one evaluation per agent."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from dohyo.evaluation.records.mixed import agents_of, drives_of
from dohyo.evaluation.records.record import AgentInfo, EpisodeRecord
from dohyo.evaluation.report.contenders import Evaluation
from dohyo.evaluation.running.run import Result
from dohyo.sumo_networks.errors import InvalidInputError


def evaluations_of(results: Sequence[Result]) -> list[Evaluation]:
    """One evaluation per result folder, and one per agent of all mixed runs together.

    Mixed runs in which agents have exchanged their missions give drives that can be compared.

    Raises:
        InvalidInputError: See `names_in_report`.
    """
    single = [result for result in results if not result.manifest.others]
    mixed = [result for result in results if result.manifest.others]
    found = [(result.manifest.agent, [result]) for result in single]
    found += [(agent, mixed) for agent in agents_of(record for result in mixed for record in result.records)]
    folders = [[result.paths[0].resolve().parents[1] for result in some] for _, some in found]
    names = names_in_report([agent for agent, _ in found], folders)
    return [_evaluation(name, agent, some) for name, (agent, some) in zip(names, found, strict=True)]


def unique_names(agents: Sequence[AgentInfo]) -> list[str]:
    """Names of agents; with settings, if one agent was evaluated under several."""
    names = [agent.name for agent in agents]
    settings = [" ".join(f"{key}={value}" for key, value in agent.settings.items()) for agent in agents]
    return [
        f"{name} ({setting})" if setting and names.count(name) > 1 else name
        for name, setting in zip(names, settings, strict=True)
    ]


def names_in_report(agents: Sequence[AgentInfo], folders: Sequence[Sequence[Path]]) -> list[str]:
    """Names of the agents of a report, all different.

    Agents with equal names and settings, such as one before and after a change of its code, have the names of their
    result folders as well.

    Args:
        agents: One for each evaluation.
        folders: Result folders of each evaluation.

    Raises:
        InvalidInputError: Two evaluations have the same agent and folders.
    """
    names = unique_names(agents)
    for equal in {name for name in names if names.count(name) > 1}:
        rows = [row for row, name in enumerate(names) if name == equal]
        for row, tail in zip(rows, _shortest_tails([folders[row] for row in rows]), strict=True):
            names[row] = f"{equal} ({tail})"
    if twice := [name for name in dict.fromkeys(names) if names.count(name) > 1]:
        raise InvalidInputError(f"expected each agent once in each result folder, got several of {', '.join(twice)}")
    return names


def _shortest_tails(folders: Sequence[Sequence[Path]]) -> list[str]:
    """The last parts of paths, as few as distinguish the groups of folders; of equal groups, the names."""
    paths = [[folder.resolve() for folder in some] for some in folders]

    def tails(depth: int) -> list[str]:
        return [", ".join("/".join(path.parts[-depth:]) for path in some) for some in paths]

    found = map(tails, range(1, max(len(path.parts) for some in paths for path in some) + 1))
    return next((some for some in found if len(set(some)) == len(some)), tails(1))


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
