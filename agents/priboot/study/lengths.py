"""Lengths: the scores of drives that are joined end to end, the same driving on longer routes.

Lengths and infractions add up, and the completion is that of all lengths. A drive that ended early counts as if the
next one had gone on, so that only the length differs. The share of a drive outside its lanes enters as an infraction.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from dohyo.agents.studies.claims import Claim, Relation
from dohyo.agents.studies.rows import Row, by_place, grouped
from dohyo.sumo_networks.arrays import FloatArray

SCORES: Final = ("IP", "DS, %", "IRS, L driven, %", "IRS, L route, %")
"""Last axis of `joined`."""
JOINED: Final = (1, 2, 4, 8, 16)
"""Number of drives that are joined to one route."""
ROUTES, SEED, LAMBDA = 400, 0, 4.0
PAIRED: Final = ("autopilot", "full", "no-rules")
"""Arms whose drives are also joined in pairs, to judge what a longer route does to a score."""
_CLAIMED: Final[Mapping[str, Relation]] = {"driving_score": "<", "irs": "="}
CLAIMS: Final = tuple(
    Claim(f"{arm} x 2", relation, f"{arm} x 1", measure, where, ablation=20)
    for where, arms in (("nocrash", PAIRED), ("leaderboard", ("full",)))
    for arm in arms
    for measure, relation in _CLAIMED.items()
)


def joined(rows: Sequence[Row], count: int) -> FloatArray:
    """(4,) mean scores over 400 routes, each of some drives drawn at random, see `SCORES`."""
    rng = np.random.default_rng(SEED)
    table = np.array([_parts(row) for row in rows])
    found: FloatArray = _scores(table[rng.integers(len(table), size=(ROUTES, count))].sum(axis=1)).mean(axis=0)
    return found


def in_pairs(rows: Sequence[Row]) -> list[Row]:
    """Rows of two drives each: as two routes (x 1) and joined (x 2).

    Partners are neighbours among the scenarios and seeds of a benchmark, in the order of their names, so that all arms
    and trainings have the same pairs. A drive whose partner was lost is left out.
    """
    places = {where: sorted({_place(row) for row in there}) for where, there in grouped(rows, "benchmark").items()}
    found = list[Row]()
    for network, arm, own in by_place(rows, PAIRED):
        for training, some in grouped(own, "training_seed").items():
            drives = {_place(row): row for row in some}
            for one, other in zip(places[network][::2], places[network][1::2], strict=False):
                if one not in drives or other not in drives:
                    continue
                cell = {"training_seed": training, "benchmark": network, "scenario": f"{one[0]}, {other[0]}"}
                both = np.array([_parts(drives[one]), _parts(drives[other])])
                for times, scores in ((1, _scores(both).mean(axis=0)), (2, _scores(both.sum(axis=0)))):
                    _, driving_score, irs, _ = scores.tolist()
                    judged = {"arm": f"{arm} x {times}", "driving_score": driving_score, "irs": irs}
                    found.append({**cell, "seed": one[1], **judged})
    return found


def _place(row: Row) -> tuple[str, int]:
    return row["scenario"], row["seed"]


def _scores(parts: FloatArray) -> FloatArray:
    """(..., 5) of `_parts` -> (..., 4) of `SCORES`."""
    done, route, driven, log_penalty, weight = np.moveaxis(parts, -1, 0)
    completion, penalty = 100.0 * done / route, np.exp(log_penalty)
    rates = [completion * np.exp(-LAMBDA * weight * 1000.0 / np.maximum(length, 1.0)) for length in (driven, route)]
    return np.stack([penalty, completion * penalty, *rates], axis=-1)


def _parts(row: Row) -> tuple[float, float, float, float, float]:
    """Metres completed, of the route and driven; logarithm of the penalty; sum of 1 - p over the infractions.

    The weight is taken back from the stored score, so that magnitudes of infractions are in it.
    """
    done = row["route_completion"] / 100.0 * row["route_m"]
    outside = row["irs"] / max(row["route_completion"], 1e-9)
    weight = -math.log(max(outside, 1e-300)) * max(row["driven_m"], 1.0) / 1000.0 / LAMBDA
    return done, row["route_m"], row["driven_m"], math.log(max(row["infraction_penalty"], 1e-300)), weight
