"""Rescoring of an evaluation under other rules."""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec
from fastapi import APIRouter, Response
from pydantic import BaseModel, ConfigDict, Field

from dohyo.service.accounts.access import Caller, Reader
from dohyo.service.boards import queries as reading
from dohyo.service.episodes.readers import Readers, ReadersOf, evaluation_for, record_of
from dohyo.service.errors import ConflictError
from dohyo.service.evaluations.access import Aspect
from dohyo.service.evaluations.metrics_views import RescoredView
from dohyo.service.evaluations.rescoring import LAMBDA, rescore
from dohyo.service.state import Services, ServicesOf
from dohyo.service.web.bodies.strict_route import StrictRoute
from dohyo.service.web.documents import problems
from dohyo.service.web.heavy import Heavy
from dohyo.service.web.spelling import ID

router = APIRouter(prefix="/v1", tags=["metrics"], responses=problems(404), route_class=StrictRoute)


class RescoringOrder(BaseModel):
    """The evaluation to rescore, and the rules."""

    model_config = ConfigDict(
        extra="forbid",
        json_schema_extra={"examples": [{"evaluation": "ev-9f86d081884c7d65", "rules": "2.1", "irs_lambda": 4.0}]},
    )

    evaluation: Annotated[str, Field(min_length=1, max_length=40, pattern=ID)]
    rules: Annotated[
        Literal["1.0", "2.0", "2.1"] | None, Field(description="CARLA Leaderboard's; by default the benchmark's own.")
    ] = None
    irs_lambda: Annotated[float, Field(ge=0, le=1000, description="km per infraction")] = LAMBDA
    irs_length: Annotated[
        Literal["completed", "driven", "route"], Field(description="Kilometres that IRS divides by.")
    ] = "completed"


@router.post("/rescore", response_model=RescoredView, responses=problems(403, 404, 409, 410, 413))
async def rescore_evaluations(
    order: RescoringOrder, caller: Reader, services: ServicesOf, readers: ReadersOf, heavy: Heavy
) -> Response:
    """Recomputes every score from the records; stored data does not change."""
    return await heavy(lambda: _rescored(order, caller, services, readers))


def _rescored(order: RescoringOrder, caller: Caller, services: Services, readers: Readers) -> Response:
    evaluation, version = evaluation_for(services, caller, order.evaluation, Aspect.RECORDS)
    if evaluation.mixed:
        raise ConflictError(
            f"evaluation '{order.evaluation}' is a mixed run: fetch its records, and `dohyo score` them"
        )
    with services.database.reading() as session:
        episodes = reading.recorded_episodes(session, order.evaluation)
        unrecorded = reading.unrecorded_drives(session, order.evaluation)
    if not episodes:
        raise ConflictError(f"evaluation '{order.evaluation}' has no finished episode yet")
    document = rescore(
        [record_of(services.settings, episode) for episode in episodes],
        rules=order.rules or readers.benchmark(version).rules,
        irs_lambda=order.irs_lambda,
        irs_length=order.irs_length,
        unrecorded=unrecorded,
    )
    return Response(msgspec.json.encode(document), media_type="application/json")
