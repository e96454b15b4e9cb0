"""Comparison of chosen evaluations."""

from __future__ import annotations

from typing import Annotated

import msgspec
from fastapi import APIRouter, Query, Response
from pydantic import StringConstraints

from dohyo.service.accounts.access import Caller, Reader
from dohyo.service.boards import queries as reading
from dohyo.service.boards.comparison import MOST, compare_entries
from dohyo.service.boards.views import ComparedView
from dohyo.service.episodes.readers import Readers, ReadersOf, evaluation_for
from dohyo.service.errors import NotFoundError
from dohyo.service.evaluations.access import Aspect
from dohyo.service.state import Services, ServicesOf
from dohyo.service.web.documents import problems
from dohyo.service.web.heavy import Heavy
from dohyo.service.web.spelling import ID

router = APIRouter(prefix="/v1", tags=["comparison"], responses=problems(403, 404))

Chosen = Annotated[
    list[Annotated[str, StringConstraints(min_length=1, max_length=40, pattern=ID)]],
    Query(min_length=2, max_length=MOST, description="Two to eight, of one benchmark version."),
]


@router.get("/comparison", response_model=ComparedView)
async def compare_evaluations(
    caller: Reader, services: ServicesOf, readers: ReadersOf, heavy: Heavy, evaluation: Chosen
) -> Response:
    """Compares evaluations drive by drive: paired difference of every score, and the scenarios that differ most."""
    return await heavy(lambda: _compared(caller, services, readers, evaluation))


def _compared(caller: Caller, services: Services, readers: Readers, evaluation: list[str]) -> Response:
    seen = [evaluation_for(services, caller, one, Aspect.RECORDS) for one in evaluation]
    with services.database.reading() as session:
        found = reading.entries(session, evaluation)
    missing = [one for one in evaluation if one not in found]
    if missing:
        raise NotFoundError(f"no evaluation '{missing[0]}'")
    headline = readers.stored(seen[0][1]).headline
    document = compare_entries([found[one] for one in evaluation], headline)
    return Response(msgspec.json.encode(document), media_type="application/json")
