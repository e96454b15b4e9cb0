"""Page of the league: who leads where, by how much, at what cost, and how sure that is."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import Final

from dohyo.agents.league.edition import Discipline, Edition, Entrant
from dohyo.agents.league.measures import MEASURES
from dohyo.agents.league.standings import Place, better_of_missions, mean_of, missions_can_tell, standings
from dohyo.agents.studies.rows import Row, infractions_per_km
from dohyo.agents.studies.tables import anchor, fixed
from dohyo.evaluation.families import Family
from dohyo.evaluation.records.specifications import InfractionKind
from dohyo.evaluation.report.style import MISSING, markdown


def page(edition: Edition, rows: Sequence[Row], more: str = "", versions: Sequence[str] = ()) -> str:
    """The page as Markdown: an overview, then each discipline, then `more`, the costs and the rules.

    Args:
        edition: What was driven.
        rows: Its rows.
        more: A section in Markdown; "": none.
        versions: Those of dohyo that drove the rows; empty: unknown, and not told.
    """
    found = {one.name: standings(one, edition.entrants_of(one), rows) for one in edition.disciplines}
    driven = f"driven with dohyo {' and '.join(versions)}, " if versions else ""
    parts = [_HEAD.format(told=edition.told, edition=edition.name, driven=driven), _overview(edition, found)]
    for discipline in edition.disciplines:
        if found[discipline.name]:
            parts += [f"## {discipline.title}", *_section(discipline, found[discipline.name])]
    parts += [more] if more else []
    if missing := [one.title for one in edition.disciplines if not found[one.name]]:
        parts += ["## Not driven so far", "\n".join(f"* {title}." for title in missing)]
    parts += ["## Who enters", _entrants(edition), "## Seeds", _seeds(edition), _rules(edition, found, rows)]
    return "\n\n".join(parts) + "\n"


_HEAD: Final = """# League

{told} Edition {edition}, {driven}written from stored rows by `dohyo league table`. Commits of one version may judge or drive differently: `facts.json` names that of each evaluation, and `dohyo league verify` compares the records.

Bold marks the leader of a discipline, and every entrant whose paired difference to the leader is not significant after a correction over all pairs. With few drives this includes entrants that drive clearly worse, so read the numbers, too. Entrants are ordered by their mean rank; a discipline that an entrant did not drive counts as the last place. [An edition of your own](researchers/evaluating.md#a-league) compares your driver in the same way."""  # noqa: E501

_RULES: Final = """## Rules

* Entrants are compared on the same drives. A difference counts if it is significant at 5 %, by flipped signs of the paired differences and after Holm's correction over all pairs of a discipline. Intervals are 95 %, bootstraps over drives or Wilson's of single vehicles' shares, and not corrected.
* Seeds of one mission are drives in different traffic, and each counts. A difference therefore holds on these missions, in any traffic. Whether it holds on other missions, only disciplines with many missions can show. For that, all seeds of a mission count once. That leaves: {left}.{few}
* Lost drives (a fault of the machine, a gridlock) are in no mean.
* Times of decisions are of a machine that did other work, too: they tell an order of magnitude, and no more.
* `dohyo league run` resumes; `dohyo league verify --sample 2` of the version that drove the rows drives two of everybody again, and compares the hashes of the records, and every measure.
* Numbers of the sources were measured in other simulators, with other traffic and roads. They stand here to be seen, not to be compared."""  # noqa: E501


def _rules(edition: Edition, found: Mapping[str, Sequence[Place]], rows: Sequence[Row]) -> str:
    """How entrants are compared, and what is left of the differences where missions count, and not drives."""
    told, few = [], []
    for one in edition.disciplines:
        if one.family is Family.DRIVING and (drives := sum(len(place.ahead_of) for place in found[one.name])):
            left = better_of_missions(one, [place.entrant for place in found[one.name]], rows)
            told.append(f"{one.name} {len(left)} of {drives}")
            few += [one.name] * (not missions_can_tell(found[one.name]))
    impossible = (
        f" In {', '.join(few)} there are too few missions to show any difference, however large." if few else ""
    )
    return _RULES.format(left=", ".join(told) or "none", few=impossible)


def _seeds(edition: Edition) -> str:
    """Who looked at which seeds."""
    told = edition.looked_at or ("Who had looked at drives with them is not told.",)
    return "\n".join(
        ["They stand in the edition's file with the samples, and were fixed before the first drive.", ""]
        + [f"* {line}" for line in told]
    )


def _overview(edition: Edition, found: Mapping[str, Sequence[Place]]) -> str:
    """Entrants over disciplines, for each family."""
    parts = []
    for family in dict.fromkeys(one.family for one in edition.disciplines):
        disciplines = [one for one in edition.disciplines if one.family is family]
        entrants = _best_first((one for one in edition.entrants if one.family is family), disciplines, found)
        heads = ["", *(f"[{one.name}](#{anchor(one.title)})" if found[one.name] else one.name for one in disciplines)]
        lines = [
            [one.name, *(_glance(discipline, found[discipline.name], one) for discipline in disciplines)]
            for one in entrants
        ]
        units = ["*measure*", *(f"*{MEASURES[one.headline].title}*" for one in disciplines)]
        parts.append(markdown(heads, [units, *lines]))
    return "\n\n".join(parts)


def _best_first(
    entrants: Iterable[Entrant], disciplines: Sequence[Discipline], found: Mapping[str, Sequence[Place]]
) -> list[Entrant]:
    """Entrants by their mean rank; where one has no rows it is behind all others."""

    def rank(entrant: Entrant, places: Sequence[Place]) -> int:
        return next((_rank(one, places) for one in places if one.entrant.name == entrant.name), 1 + len(places))

    return sorted(entrants, key=lambda entrant: sum(rank(entrant, found[one.name]) for one in disciplines))


def _glance(discipline: Discipline, places: Sequence[Place], entrant: Entrant) -> str:
    for place in places:
        if place.entrant.name == entrant.name and place.score.mean is not None:
            text = f"{place.score.mean:.{MEASURES[discipline.headline].digits}f}"
            return f"**{text}**" if place.leads else text
    return MISSING


def _section(discipline: Discipline, places: Sequence[Place]) -> list[str]:
    told = f"{discipline.told} Benchmark `{discipline.benchmark}`, ranked by {MEASURES[discipline.headline].title}."
    lines = [_line(discipline, places, place) for place in places]
    measures = [MEASURES[one].title for one in (discipline.headline, *discipline.then)]
    per_km = ["infractions per km driven"] if discipline.family is Family.DRIVING else []
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
    scores += [fixed(mean_of(place.rows, name, one), MEASURES[one].digits) or MISSING for one in discipline.then]
    per_km = [_most_frequent(place.rows)] if discipline.family is Family.DRIVING else []
    units = f"{len(place.rows)}" + (f", {place.lost} lost" if place.lost else "")
    decision = MISSING if place.decision_ms is None else f"{place.decision_ms:.3g}"
    ahead = ", ".join(place.ahead_of) or MISSING
    source = place.entrant.reported.get(discipline.name)
    told = f"*{source}*" if source else MISSING
    shown = [f"**{one}**" if place.leads else one for one in (name, scores[0])]
    return [f"{_rank(place, places)}", shown[0], shown[1], *scores[1:], *per_km, units, decision, ahead, told]


def _rank(place: Place, places: Sequence[Place]) -> int:
    """Number of entrants with a better mean, and 1."""
    return 1 + next(number for number, one in enumerate(places) if one.score.mean == place.score.mean)


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
