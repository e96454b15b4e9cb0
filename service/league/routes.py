"""The league of dohyo's own systems, from the rows that come with dohyo."""

from __future__ import annotations

import dataclasses
from functools import cache

from fastapi import APIRouter

from dohyo.agents.league.edition import PUBLISHED, Discipline, read_edition
from dohyo.agents.league.measures import MEASURES
from dohyo.agents.league.rows import read_comparable_rows, versions_of
from dohyo.agents.league.standings import Place, mean_of, standings
from dohyo.service.accounts.access import Reader
from dohyo.service.league.views import LeagueDisciplineView, LeagueMeasureView, LeaguePlaceView, LeagueView
from dohyo.service.web.documents import problems
from dohyo.service.web.heavy import heavy_read
from dohyo.sumo_networks.errors import InvalidInputError

router = APIRouter(prefix="/v1/league", tags=["leaderboard"])


@router.get("", responses=problems())
@heavy_read
def get_league(caller: Reader) -> LeagueView:
    """Dohyo's own systems in parts of benchmarks, with paired tests between all of them."""
    try:
        return league()
    except InvalidInputError as error:  # no fault of the caller: the rows come with dohyo
        raise RuntimeError(str(error)) from error


def check_league() -> None:
    """Checks that the league can be shown.

    Raises:
        InvalidInputError: The edition or its rows are damaged.
    """
    read_comparable_rows(read_edition(), PUBLISHED)


@cache
def league() -> LeagueView:
    """The standings, which do not change while a service runs."""
    edition = read_edition()
    rows = read_comparable_rows(edition, PUBLISHED)
    return LeagueView(
        edition=edition.name,
        versions=sorted(versions_of(PUBLISHED, rows)),
        told=edition.told,
        looked_at=list(edition.looked_at),
        disciplines=[_discipline(one, standings(one, edition.entrants_of(one), rows)) for one in edition.disciplines],
    )


def _discipline(discipline: Discipline, places: list[Place]) -> LeagueDisciplineView:
    measures = (discipline.headline, *discipline.then)
    return LeagueDisciplineView(
        name=discipline.name,
        title=discipline.title,
        told=discipline.told,
        benchmark=discipline.benchmark,
        family=discipline.family,
        measures=[LeagueMeasureView(key=key, title=MEASURES[key].title, lower=MEASURES[key].lower) for key in measures],
        places=[_place(discipline, place, measures) for place in places],
    )


def _place(discipline: Discipline, place: Place, measures: tuple[str, ...]) -> LeaguePlaceView:
    entrant = place.entrant
    scores = {key: mean_of(place.rows, entrant.name, key) for key in measures}
    return LeaguePlaceView.model_validate(
        {
            "entrant": entrant.name,
            "system": entrant.system,
            "thesis": entrant.thesis or None,
            "parameters": entrant.parameters,
            "leads": place.leads,
            "scores": {key: dataclasses.asdict(one) for key, one in scores.items()},
            "better_than": list(place.ahead_of),
            "counted": len(place.rows),
            "lost": place.lost,
            "decision_ms": place.decision_ms,
            "reported": entrant.reported.get(discipline.name),
        }
    )
