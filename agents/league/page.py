"""Page of the league: who leads where, by how much, at what cost, and how sure that is."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from statistics import median
from typing import Final

from dohyo.agents.league.edition import Discipline, Edition, Entrant
from dohyo.agents.studies.claims import Claim, Judgement, judge
from dohyo.agents.studies.crossed_bootstrap import Matched, estimate
from dohyo.agents.studies.rows import Row, infractions_per_km, is_lost, matched
from dohyo.agents.studies.tables import fixed
from dohyo.evaluation.families import Family
from dohyo.evaluation.records.specifications import InfractionKind
from dohyo.evaluation.report.style import MISSING, markdown
from dohyo.evaluation.statistics import Estimate, mean_estimate, share_estimate

LEVEL: Final = 0.05


@dataclass(frozen=True, slots=True)
class Measure:
    """A measure of the rows.

    Attributes:
        title: Name for people, with its unit.
        lower: Whether lower values are better.
        share: Whether each drive has 0 or 100.
        digits: Decimals.
    """

    title: str
    lower: bool = False
    share: bool = False
    digits: int = 1


MEASURES: Final[Mapping[str, Measure]] = {
    "driving_score": Measure("driving score"),
    "nocrash_success": Measure("success without a collision, %", share=True),
    "success": Measure("success, %"),
    "route_completion": Measure("route completion, %"),
    "irs": Measure("infraction rate score"),
    "closed_loop": Measure("closed-loop score"),
    "aligned": Measure("aligned, % of successes"),
    "time_s": Measure("time, s", lower=True),
    "mse": Measure("MSE x 1000", lower=True, digits=2),
    "speed_std_mps": Measure("deviation of all speeds, m/s", lower=True, digits=2),
    "throughput_vph": Measure("throughput, vehicles/h", digits=0),
}


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
    """

    entrant: Entrant
    rows: Sequence[Row]
    lost: int
    score: Estimate
    ahead_of: tuple[str, ...]
    behind: tuple[str, ...]

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
        score = _mean(kept, one.name, discipline.headline)
        places.append(Place(one, kept, len(own) - len(kept), score, ahead, behind))
    return sorted(places, key=lambda place: (place.score.mean or 0.0) * (1.0 if measure.lower else -1.0))


def _better(discipline: Discipline, entrants: Sequence[Entrant], rows: Sequence[Row]) -> list[tuple[str, str]]:
    """Pairs of a better and a worse entrant, on the drives of both."""
    claims = [Claim(a.name, ">", b.name, discipline.headline) for a, b in combinations(entrants, 2)]
    judged = judge(claims, lambda claim, arm: _values(rows, arm, claim.measure))
    return [_ordered(one, MEASURES[discipline.headline].lower) for one in judged if one.adjusted < LEVEL]


def _ordered(one: Judgement, lower: bool) -> tuple[str, str]:
    higher_first = (one.claim.left, one.claim.right)
    left_is_higher = (one.difference.mean or 0.0) > 0.0
    return higher_first if left_is_higher is not lower else higher_first[::-1]


def _values(rows: Iterable[Row], arm: str, measure: str) -> Matched:
    return matched((row for row in rows if row.get(measure) is not None), arm, measure)


def _mean(rows: Sequence[Row], arm: str, measure: str) -> Estimate:
    values = _values(rows, arm, measure)
    if not values:
        return Estimate(None, None, None, 0)
    return estimate(values, _share if MEASURES[measure].share else mean_estimate)


def _share(values: Sequence[float]) -> Estimate:
    return share_estimate([value > 0.0 for value in values])


def page(edition: Edition, rows: Sequence[Row]) -> str:
    """The page as Markdown: an overview, then each discipline, then the costs and the rules."""
    found = {one.name: standings(one, edition.entrants_of(one), rows) for one in edition.disciplines}
    parts = [_HEAD.format(edition=edition.name), _overview(edition, found)]
    for discipline in edition.disciplines:
        parts += [f"## {discipline.title}", *_section(discipline, found[discipline.name])]
    return "\n\n".join([*parts, "## Who enters", _entrants(edition), _RULES]) + "\n"


_HEAD: Final = """# League

Every system of three theses, and rivals, on every benchmark, under one metric. Edition {edition}, written from stored rows by `dohyo league table --out docs/league.md`.

In bold stands who leads a discipline, and everybody whose paired difference to the leader is not significant."""  # noqa: E501

_RULES: Final = """## Rules

* Seeds and samples stand in `agents/league/edition.toml` and were fixed before the first drive. No agent was trained, tuned or chosen on them. Forecasts have fixed days, and planners were developed on other excerpts.
* Entrants are compared on the same drives. A difference counts if it is significant at 5 % after Holm's correction over all pairs of a discipline. Intervals are 95 % bootstraps over drives, not corrected.
* Lost drives (a fault of the machine, a gridlock) are in no mean.
* Times are of the machine of the run, and say only which agent is slow.
* `dohyo league run` resumes; `dohyo league verify --sample 2` drives two rows of everybody again and compares the hashes of the records.
* Numbers of the sources were measured in other simulators, with other traffic and roads. They stand here to be seen, not to be compared."""  # noqa: E501


def _overview(edition: Edition, found: Mapping[str, Sequence[Place]]) -> str:
    """Entrants over disciplines, for each family."""
    parts = []
    for family in dict.fromkeys(one.family for one in edition.disciplines):
        disciplines = [one for one in edition.disciplines if one.family is family]
        entrants = [one for one in edition.entrants if one.family is family]
        heads = ["", *(f"[{one.name}](#{_anchor(one.title)})" for one in disciplines)]
        lines = [
            [one.name, *(_glance(discipline, found[discipline.name], one) for discipline in disciplines)]
            for one in entrants
        ]
        units = ["*measure*", *(f"*{MEASURES[one.headline].title}*" for one in disciplines)]
        parts.append(markdown(heads, [units, *lines]))
    return "\n\n".join(parts)


def _glance(discipline: Discipline, places: Sequence[Place], entrant: Entrant) -> str:
    for place in places:
        if place.entrant.name == entrant.name and place.score.mean is not None:
            text = f"{place.score.mean:.{MEASURES[discipline.headline].digits}f}"
            return f"**{text}**" if _leads(places, place) else text
    return MISSING


def _leads(places: Sequence[Place], place: Place) -> bool:
    """Whether nobody is significantly better than this one, or this one is first."""
    first = places[0].entrant.name
    return place.entrant.name == first or first not in place.behind


def _section(discipline: Discipline, places: Sequence[Place]) -> list[str]:
    told = f"{discipline.told} Benchmark `{discipline.benchmark}`, ranked by {MEASURES[discipline.headline].title}."
    if not places:
        return [told, "*Not driven so far.*"]
    lines = [_line(discipline, places, place) for place in places]
    measures = [MEASURES[one].title for one in (discipline.headline, *discipline.then)]
    per_km = ["infractions per km"] if discipline.family is Family.DRIVING else []
    heads = ["", "entrant", *measures, *per_km, _UNITS[discipline.family], "ms", "better than", "its source says"]
    return [told, markdown(heads, lines)]


_UNITS: Final[Mapping[Family, str]] = {
    Family.DRIVING: "drives",
    Family.PARKING: "lots",
    Family.FORECASTING: "days",
    Family.FREEWAY: "mornings",
}


def _line(discipline: Discipline, places: Sequence[Place], place: Place) -> list[str]:
    name = place.entrant.name
    scores = [fixed(place.score, MEASURES[discipline.headline].digits)]
    scores += [fixed(_mean(place.rows, name, one), MEASURES[one].digits) or MISSING for one in discipline.then]
    per_km = [_most_frequent(place.rows)] if discipline.family is Family.DRIVING else []
    units = f"{len(place.rows)}" + (f", {place.lost} lost" if place.lost else "")
    decision = MISSING if place.decision_ms is None else f"{place.decision_ms:.3g}"
    ahead = ", ".join(place.ahead_of) or MISSING
    source = place.entrant.reported.get(discipline.name)
    told = f"*{source}*" if source else MISSING
    leads = _leads(places, place)
    shown = [f"**{one}**" if leads else one for one in (name, scores[0])]
    rank = f"{places.index(place) + 1}"
    return [rank, shown[0], shown[1], *scores[1:], *per_km, units, decision, ahead, told]


def _most_frequent(rows: Sequence[Row], count: int = 3) -> str:
    """The most frequent infractions of some drives, per km."""
    _, per_km = infractions_per_km(rows)
    told = [
        f"{rate:.2f} {InfractionKind(kind).specification.label}"
        for kind, rate in Counter(per_km).most_common(count)
        if not math.isclose(rate, 0.0)
    ]
    return ", ".join(told) or "none"


def _entrants(edition: Edition) -> str:
    lines = [
        [one.name, one.system, one.thesis or MISSING, f"{one.parameters:,}" if one.weights else MISSING]
        for one in edition.entrants
    ]
    return markdown(["entrant", "system", "thesis", "learned parameters"], lines)


def _anchor(title: str) -> str:
    kept = (letter for letter in title.lower() if letter.isalnum() or letter in " -")
    return "".join(kept).replace(" ", "-")
