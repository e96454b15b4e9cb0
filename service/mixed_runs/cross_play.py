"""Cross-play: the score of each agent in mixed runs with each other agent, and in runs with copies of itself.

A drive beside several other agents counts for each of them. A drive that was driven again, with an equal record, counts
once. Drives of gridlocked episodes are lost: they count in no mean, and are told beside it.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any, Final

from sqlalchemy.orm import Session

from dohyo.evaluation.statistics import Estimate
from dohyo.service.boards.leaderboard import Driver, Entry
from dohyo.service.boards.queries import entries
from dohyo.service.boards.standings import Recent
from dohyo.service.evaluations.scoring import Drive, estimate_values, rank_sign

Scores = dict[tuple[str, str], float]
"""Scores of drives by record and ego, so that each drive is there once; NaN of a lost one."""

Meetings = Mapping[tuple[Driver, Driver | None], Scores]
"""Scores of a driver beside another one; beside itself: in a run alone; beside None: in any mixed run."""

RUNS: Final = 400
ESTIMATES: Final = 10_000
MATRICES: Final = 20


class CrossPlays:
    """Matrices of cross-play, in memory with the runs they are made from, since complete runs never change."""

    def __init__(self) -> None:
        self._runs: Recent[str, Meetings] = Recent(RUNS)
        self._estimates: Recent[tuple[str, bytes], Estimate] = Recent(ESTIMATES)
        self._matrices: Recent[tuple[str, ...], dict[str, Any]] = Recent(MATRICES)

    def meetings(self, session: Session, evaluation_ids: Sequence[str], metric: str) -> dict[str, Meetings]:
        """Meetings in complete runs, by evaluation; unknown ids give none.

        Args:
            session: To read in.
            evaluation_ids: Runs on one benchmark version.
            metric: Score that ranks on the benchmark.
        """
        known = {one: self._runs.get(one) for one in evaluation_ids}
        unknown = [one for one, meetings in known.items() if meetings is None]
        for one, entry in (entries(session, unknown) if unknown else {}).items():
            known[one] = meetings = meetings_of(entry, metric)
            self._runs.put(one, meetings)
        return {one: meetings for one, meetings in known.items() if meetings is not None}

    def matrix(self, mixed: Mapping[str, Meetings], alone: Mapping[str, Meetings], metric: str) -> dict[str, Any]:
        """The matrix of the agents of mixed runs, as plain JSON.

        Args:
            mixed: Meetings in mixed runs on one benchmark version, by evaluation.
            alone: The same in runs of one agent; those of agents without a mixed run are left out.
            metric: Score that ranks on the benchmark.

        Returns:
            `agents`: each with its score over all of its mixed drives, the best first, those without any at the end.
            `cells`: the score of `submission` beside `other`, for all pairs that met; with `other` the same, that of
            its runs alone.
        """
        return self._matrices.get_or_make(
            (*mixed, *alone), lambda: self._matrix([*mixed.values(), *alone.values()], metric)
        )

    def _matrix(self, runs: Sequence[Meetings], metric: str) -> dict[str, Any]:
        beside: dict[tuple[Driver, Driver | None], Scores] = {}
        for meetings in runs:
            for pair, scores in meetings.items():
                beside.setdefault(pair, {}).update(scores)
        agents = [
            {**asdict(own), **self._score(scores, metric)} for (own, other), scores in beside.items() if other is None
        ]
        agents.sort(key=lambda one: (_place(one["score"]["mean"], metric), one["agent"], one["version"]))
        order = {one["submission"]: place for place, one in enumerate(agents)}
        cells = [
            {"submission": own.submission, "other": other.submission, **self._score(scores, metric)}
            for (own, other), scores in beside.items()
            if other is not None and own.submission in order
        ]
        cells.sort(key=lambda one: (order[one["submission"]], order[one["other"]]))
        return {"agents": agents, "cells": cells}

    def _score(self, scores: Scores, metric: str) -> dict[str, Any]:
        """Mean of scores; it is known already where no drive of the pair is new."""
        by_record: dict[str, list[float]] = {}
        for (record, _), score in scores.items():
            if not math.isnan(score):
                by_record.setdefault(record, []).append(score)
        episodes = sorted(sorted(some) for some in by_record.values())
        key = metric, hashlib.blake2b(repr(episodes).encode(), digest_size=16).digest()
        estimate = self._estimates.get_or_make(key, lambda: estimate_values(metric, episodes))
        drives = sum(map(len, episodes))
        return {
            "score": asdict(estimate),
            "drives": drives,
            "episodes": len(episodes),
            "lost": len(scores) - drives,
        }


def meetings_of(entry: Entry, metric: str) -> Meetings:
    """The meetings in one run."""
    scored = [(drive, drive.score(metric)) for drive in entry.drives]
    scored += [(drive, math.nan) for drive in entry.gridlocked]
    if not entry.others:
        return {(entry.driver, entry.driver): {_key(drive): score for drive, score in scored}}
    episodes: dict[str, list[tuple[Drive, float]]] = {}
    for drive, score in scored:
        episodes.setdefault(drive.episode, []).append((drive, score))
    found: dict[tuple[Driver, Driver | None], Scores] = {}
    for drives in episodes.values():
        drivers = {entry.driver_of(drive.ego) for drive, _ in drives}
        for drive, score in drives:
            own = entry.driver_of(drive.ego)
            for other in (None, *(drivers - {own})):
                found.setdefault((own, other), {})[_key(drive)] = score
    return found


def _place(mean: float | None, metric: str) -> float:
    return math.inf if mean is None else -rank_sign(metric) * mean


def _key(drive: Drive) -> tuple[str, str]:
    return drive.record_hash or drive.episode, drive.ego
