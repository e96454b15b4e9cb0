"""Rescoring: an evaluation's records under other rules. Stored data does not change."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any, Final

from dohyo.evaluation.records.record import EpisodeRecord
from dohyo.evaluation.scores.driving import IrsLength, Rules, infraction_rate_score
from dohyo.evaluation.statistics import grouped_estimate, mean_estimate
from dohyo.evaluation.summary import Summary, as_document, score_drive, summarise, summarise_cells

LAMBDA: Final = 4.0


def rescore(
    records: Sequence[EpisodeRecord],
    *,
    rules: Rules,
    irs_lambda: float = LAMBDA,
    irs_length: IrsLength = "completed",
    unrecorded: Mapping[str, int] = MappingProxyType({}),
) -> dict[str, Any]:
    """Computes every score from the records, as `dohyo score --json` does; plain JSON.

    Args:
        records: Records of one agent and one benchmark version.
        rules: Rules of the driving score.
        irs_lambda: Decay of the infraction rate score, km per infraction.
        irs_length: Distance that its kilometres count: completed, driven or route.
        unrecorded: Number of drives that were lost without a record, by cell.

    Returns:
        The summary of all drives, with `irs_lambda`, `cells` (a summary each) and `drives`.

    Raises:
        InvalidInputError: There are no records, they do not belong together, or lambda is out of range.
    """
    everywhere = sum(unrecorded.values())
    summary = summarise(records, rules=rules, irs_length=irs_length, unrecorded=everywhere)
    cells = summarise_cells(records, rules=rules, irs_length=irs_length, unrecorded=unrecorded)
    by_cell = {cell: [record for record in records if record.scenario.cell == cell] for cell in cells}
    return {
        **as_document(_with_lambda(summary, records, irs_lambda)),
        "irs_lambda": irs_lambda,
        "cells": {cell: as_document(_with_lambda(one, by_cell[cell], irs_lambda)) for cell, one in cells.items()},
        "drives": [
            {
                "scenario": record.scenario.name,
                "seed": record.scenario.seed,
                "ego": ego.name,
                **score_drive(ego, rules=rules, irs_length=irs_length),
                "irs": infraction_rate_score(ego, irs_lambda, irs_length),
            }
            for record in _counted(records)
            for ego in record.egos
        ],
    }


def _with_lambda(summary: Summary, records: Sequence[EpisodeRecord], irs_lambda: float) -> Summary:
    episodes = [
        [infraction_rate_score(ego, irs_lambda, summary.irs_length) for ego in one.egos] for one in _counted(records)
    ]
    scores = {**summary.scores, "irs": grouped_estimate(episodes, mean_estimate)}
    as_zero = summary.scores_lost_as_zero
    if as_zero is not None:
        zeros = [[0.0] * len(one.egos) for one in records if one.lost]
        unrecorded = as_zero["irs"].n - scores["irs"].n - sum(map(len, zeros))
        zeros += [[0.0]] * unrecorded
        as_zero = {**as_zero, "irs": grouped_estimate([*episodes, *zeros], mean_estimate)}
    return dataclasses.replace(summary, scores=scores, scores_lost_as_zero=as_zero)


def _counted(records: Sequence[EpisodeRecord]) -> list[EpisodeRecord]:
    return [record for record in records if not record.lost]
