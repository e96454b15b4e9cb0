"""Comparison of evaluations of one benchmark version, drive by drive, and where they differ most."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from itertools import combinations
from typing import Any, Final

from dohyo.service.boards.leaderboard import Entry
from dohyo.service.evaluations.scoring import compare_drives, lost_episodes, scores_of, summarise_drives
from dohyo.sumo_networks.errors import InvalidInputError

MOST: Final = 8
SCENARIOS: Final = 10


def compare_entries(entries: Sequence[Entry], metric: str) -> dict[str, Any]:
    """Compares two to eight evaluations; plain JSON.

    Args:
        entries: Evaluations of one benchmark version; different versions have no common scale and are refused.
        metric: The benchmark's headline.

    Returns:
        `evaluations` with their summaries, `pairs` with a comparison per score (a - b, on the drives both made; None
        where there are none), `scenarios`: those all have driven on which the headline differs most.

    Raises:
        InvalidInputError: Too few, too many, one twice, one mixed or without a drive, or of different versions.
    """
    _check(entries)
    return {
        "benchmark": entries[0].benchmark,
        "benchmark_sha256": entries[0].benchmark_sha256,
        "metric": metric,
        "evaluations": [_side(entry) for entry in entries],
        "pairs": [_pair(a, b) for a, b in combinations(entries, 2)],
        "scenarios": differing_scenarios(entries, metric),
    }


def differing_scenarios(entries: Sequence[Entry], metric: str, most: int = SCENARIOS) -> list[dict[str, Any]]:
    """The scenarios with the largest spread of a score, ties by the driving score's, then by name and seed.

    Those that a side failed without a score are left out.
    """
    sides, second = [_by_scenario(entry) for entry in entries], _second(entries, metric)
    common = set.intersection(*(set(side) for side in sides))
    found = []
    for scenario, seed in common:
        drives = [side[scenario, seed] for side in sides]
        if not all(metric in scores_of(some) for some in drives):
            continue  # a day or morning on which the agent failed has no score
        values = [_mean([drive.score(metric) for drive in some]) for some in drives]
        scores = [_mean([drive.score(second) for drive in some]) for some in drives]
        found.append(
            {
                "scenario": scenario,
                "seed": seed,
                "cell": drives[0][0].cell,
                "spread": max(values) - min(values),
                "values": values,
                "driving_scores": scores,
                "episodes": [some[0].episode for some in drives],
                "statuses": [[drive.status.value for drive in some] for some in drives],
            }
        )
    found.sort(key=lambda one: (-one["spread"], min(one["driving_scores"]) - max(one["driving_scores"]), *_name(one)))
    return [one for one in found if one["spread"] or len(set(one["driving_scores"])) > 1][:most]


def _second(entries: Sequence[Entry], metric: str) -> str:
    """The score that decides between equal ones: the driving score, where all drives have it."""
    return "driving_score" if all("driving_score" in scores_of(entry.drives) for entry in entries) else metric


def _check(entries: Sequence[Entry]) -> None:
    if not 2 <= len(entries) <= MOST:
        raise InvalidInputError(f"expected 2 to {MOST} evaluations to compare, got {len(entries)}")
    ids = [entry.evaluation for entry in entries]
    if len(set(ids)) != len(ids):
        raise InvalidInputError(f"expected different evaluations, got {', '.join(ids)}")
    versions = {entry.benchmark_sha256: entry.benchmark for entry in entries}
    if len(versions) > 1:
        names = ", ".join(sorted(f"{name} {sha256[:12]}" for sha256, name in versions.items()))
        raise InvalidInputError(f"expected evaluations of one benchmark version, got {names}")
    for entry in entries:
        if entry.others:
            raise InvalidInputError(f"expected runs of one agent, and evaluation '{entry.evaluation}' is a mixed run")
        if not entry.drives:
            why = "lost all of its drives" if entry.lost else "has no finished episode yet"
            raise InvalidInputError(f"evaluation '{entry.evaluation}' {why}")


def _side(entry: Entry) -> dict[str, Any]:
    return {
        "evaluation": entry.evaluation,
        "agent": entry.agent,
        "version": entry.version,
        "track": entry.track,
        "seeds": len(entry.seeds),
        "dohyo_versions": list(entry.dohyo_versions),
        **summarise_drives(entry.drives, lost_episodes(sum(entry.lost.values()), entry.gridlocked)),
    }


def _pair(a: Entry, b: Entry) -> dict[str, Any]:
    scores = {name: compare_drives(name, a.drives, b.drives) for name in scores_of((*a.drives, *b.drives))}
    return {
        "a": a.evaluation,
        "b": b.evaluation,
        "scores": {name: asdict(score) if score else None for name, score in scores.items()},
    }


def _by_scenario(entry: Entry) -> dict[tuple[str, int], list[Any]]:
    grouped: dict[tuple[str, int], list[Any]] = {}
    for drive in entry.drives:
        grouped.setdefault((drive.scenario, drive.seed), []).append(drive)
    return grouped


def _mean(values: Sequence[float]) -> float:
    return sum(values) / len(values)


def _name(one: dict[str, Any]) -> tuple[str, int]:
    return one["scenario"], one["seed"]
