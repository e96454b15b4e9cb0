"""Standings: the places of a discipline, with paired tests between all entrants."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from statistics import fmean, median
from typing import Any, Final

from dohyo.agents.league.edition import Discipline, Entrant
from dohyo.agents.league.measures import MEASURES, Measure
from dohyo.agents.studies.claims import Claim, Judgement, judge
from dohyo.agents.studies.crossed_bootstrap import Matched, estimate, of_shares
from dohyo.agents.studies.rows import Row, is_lost, matched
from dohyo.evaluation.statistics import Estimate, mean_estimate

LEVEL: Final = 0.05


@dataclass(frozen=True, slots=True)
class Place:
    """An entrant in a discipline.

    Attributes:
        entrant: The entrant.
        rows: Its rows, without lost ones.
        lost: Number of rows that were lost.
        score: Of the headline.
        ahead_of: Entrants that are worse, after Holm's correction over all pairs of the discipline.
        behind: Entrants that are better, likewise.
        leads: Whether it is first, or the first is not better by that test.
    """

    entrant: Entrant
    rows: Sequence[Row]
    lost: int
    score: Estimate
    ahead_of: tuple[str, ...]
    behind: tuple[str, ...]
    leads: bool

    @property
    def decision_ms(self) -> float | None:
        """Median time of a decision; None where it was not measured."""
        found = [row["decision_ms"] for row in self.rows if row.get("decision_ms") is not None]
        return median(found) if found else None


def standings(discipline: Discipline, entrants: Iterable[Entrant], rows: Sequence[Row]) -> list[Place]:
    """Places of a discipline, the best first; who has no rows is left out."""
    mine = [row for row in rows if row["benchmark"] == discipline.name]
    there = [one for one in entrants if any(row["arm"] == one.name and not is_lost(row) for row in mine)]
    measure = MEASURES[discipline.headline]
    better = _better(discipline, there, mine)
    places = []
    for one in there:
        own = [row for row in mine if row["arm"] == one.name]
        ahead = tuple(loser for winner, loser in better if winner == one.name)
        behind = tuple(winner for winner, loser in better if loser == one.name)
        kept = [row for row in own if not is_lost(row)]
        score = mean_of(kept, one.name, discipline.headline)
        places.append(Place(one, kept, len(own) - len(kept), score, ahead, behind, leads=False))
    places.sort(key=lambda place: _order(place.score, measure))
    return [replace(place, leads=_leads(place, places[0])) for place in places]


def better_of_missions(
    discipline: Discipline, entrants: Iterable[Entrant], rows: Sequence[Row]
) -> list[tuple[str, str]]:
    """Pairs of a better and a worse entrant where all seeds of a mission count once, by their mean.

    Such a pair differs on other missions, too. An entrant with a lost drive has the mean of its mission's others.
    """
    return _better(discipline, list(entrants), [row for row in rows if row["benchmark"] == discipline.name], _missions)


def missions_can_tell(places: Sequence[Place]) -> bool:
    """Whether the best entrant of a discipline could be better than the worst where all seeds of a mission count once.

    The smallest p-value of flipped signs is 2 / 2^n for n missions, and it is corrected over all pairs.
    """
    missions = len({row["scenario"] for place in places for row in place.rows})
    return math.comb(len(places), 2) * 2.0 ** (1 - missions) < LEVEL


def _missions(matched: Matched) -> Matched:
    """Mean over the seeds of each mission, as one scenario."""
    seeds: dict[tuple[Any, ...], list[float]] = {}
    for (benchmark, mission, _), values in matched.items():
        seeds.setdefault((benchmark, mission), []).extend(values.values())
    return {mission: {None: fmean(values)} for mission, values in seeds.items()}


def _order(score: Estimate, measure: Measure) -> tuple[bool, float]:
    """Key by which the best comes first, and who has no value last."""
    return score.mean is None, (score.mean or 0.0) * (1.0 if measure.lower else -1.0)


def _leads(place: Place, first: Place) -> bool:
    return place.score.mean is not None and first.entrant.name not in place.behind


def _better(
    discipline: Discipline,
    entrants: Sequence[Entrant],
    rows: Sequence[Row],
    unit: Callable[[Matched], Matched] = lambda drives: drives,
) -> list[tuple[str, str]]:
    """Pairs of a better and a worse entrant, on what both drove; `unit` makes of drives what counts once."""
    claims = [Claim(a.name, ">", b.name, discipline.headline) for a, b in combinations(entrants, 2)]
    judged = judge(claims, lambda claim, arm: unit(_values(rows, arm, claim.measure)))
    return [_ordered(one, MEASURES[discipline.headline].lower) for one in judged if one.adjusted < LEVEL]


def _ordered(one: Judgement, lower: bool) -> tuple[str, str]:
    higher_first = (one.claim.left, one.claim.right)
    left_is_higher = (one.difference.mean or 0.0) > 0.0
    return higher_first if left_is_higher is not lower else higher_first[::-1]


def _values(rows: Iterable[Row], arm: str, measure: str) -> Matched:
    return matched((row for row in rows if row.get(measure) is not None), arm, measure)


def mean_of(rows: Sequence[Row], arm: str, measure: str) -> Estimate:
    """Mean of a measure over the rows of an entrant that have it, with its interval."""
    values = _values(rows, arm, measure)
    if not values:
        return Estimate(None, None, None, 0)
    single = all(one in (0.0, 100.0) for seeds in values.values() for one in seeds.values())  # not several karts' mean
    return estimate(values, of_shares if MEASURES[measure].share and single else mean_estimate)
