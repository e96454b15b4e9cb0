"""Cross-play: the score of each agent in mixed runs with each other agent, and in runs with copies of itself.

A drive beside several other agents counts for each of them. A drive that was driven again, with an equal record, counts
once.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict
from typing import Any

from dohyo.service.boards.leaderboard import Driver, Entry
from dohyo.service.evaluations.scoring import Drive, estimate, rank_sign

_Drives = dict[tuple[str, str], Drive]
"""Drives by record and ego, so that each one is there once."""


def cross_play(mixed: Sequence[Entry], alone: Sequence[Entry], metric: str) -> dict[str, Any]:
    """The matrix of the agents of mixed runs, as plain JSON.

    Args:
        mixed: Mixed runs on one benchmark version.
        alone: Runs of one agent on it; those of agents without a mixed run are left out.
        metric: Score that ranks on the benchmark.

    Returns:
        `agents`: each with its score over all of its mixed drives, the best first. `cells`: the score of `submission`
        beside `other`, for all pairs that met; with `other` the same, that of its runs alone.
    """
    everything: dict[Driver, _Drives] = {}
    beside: dict[tuple[Driver, Driver], _Drives] = {}
    for entry in mixed:
        for drive, own, others in _meetings(entry):
            everything.setdefault(own, {})[_key(drive)] = drive
            for other in others:
                beside.setdefault((own, other), {})[_key(drive)] = drive
    for entry in alone:
        if entry.driver in everything:
            beside.setdefault((entry.driver, entry.driver), {}).update({_key(drive): drive for drive in entry.drives})
    agents = [{**asdict(driver), **_score(drives, metric)} for driver, drives in everything.items()]
    agents.sort(key=lambda one: (-rank_sign(metric) * one["score"]["mean"], one["agent"], one["version"]))
    order = {one["submission"]: place for place, one in enumerate(agents)}
    cells = [
        {"submission": own.submission, "other": other.submission, **_score(drives, metric)}
        for (own, other), drives in beside.items()
    ]
    return {
        "agents": agents,
        "cells": sorted(cells, key=lambda one: (order[one["submission"]], order[one["other"]])),
    }


def _meetings(entry: Entry) -> Iterator[tuple[Drive, Driver, set[Driver]]]:
    """Every drive of a mixed run, with its driver and the other drivers of its episode."""
    episodes: dict[str, list[Drive]] = {}
    for drive in entry.drives:
        episodes.setdefault(drive.episode, []).append(drive)
    for drives in episodes.values():
        drivers = {entry.driver_of(drive.ego) for drive in drives}
        for drive in drives:
            own = entry.driver_of(drive.ego)
            yield drive, own, drivers - {own}


def _key(drive: Drive) -> tuple[str, str]:
    return drive.record_hash or drive.episode, drive.ego


def _score(drives: _Drives, metric: str) -> dict[str, Any]:
    return {
        "score": asdict(estimate(metric, list(drives.values()))),
        "drives": len(drives),
        "episodes": len({record for record, _ in drives}),
    }
