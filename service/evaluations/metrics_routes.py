"""Metrics of an evaluation as JSON, as CSV, and as places on the map."""

from __future__ import annotations

from typing import Any

import msgspec
from fastapi import APIRouter, Response

from dohyo.service.accounts.access import Reader
from dohyo.service.boards import queries as reading
from dohyo.service.boards.leaderboard import Entry
from dohyo.service.episodes.readers import ReadersOf, evaluation_for
from dohyo.service.episodes.reading_views import InfractionsView, InfractionView
from dohyo.service.errors import NotFoundError
from dohyo.service.evaluations.access import Aspect
from dohyo.service.evaluations.metrics import as_csv, as_document
from dohyo.service.evaluations.metrics_views import MetricsView
from dohyo.service.state import Services, ServicesOf
from dohyo.service.web.caching import Identified
from dohyo.service.web.documents import problems
from dohyo.service.web.heavy import heavy_read

router = APIRouter(tags=["metrics"], responses=problems())
CSV: dict[int | str, dict[str, Any]] = {
    200: {"description": "A row per drive and cell.", "content": {"text/csv": {"schema": {"type": "string"}}}}
}


@router.get("/v1/evaluations/{identifier}/metrics", response_model=MetricsView, responses=problems(403, 404))
@heavy_read
def get_evaluation_metrics(identifier: Identified, caller: Reader, services: ServicesOf) -> Response:
    """Scores with intervals over all finished episodes, by cell, and for every drive."""
    evaluation_for(services, caller, identifier, Aspect.RECORDS)
    document = as_document(_entry(services, identifier))
    return Response(msgspec.json.encode(document), media_type="application/json")


@router.get("/v1/evaluations/{identifier}/metrics.csv", response_class=Response, responses=problems(403, 404) | CSV)
@heavy_read
def get_evaluation_metrics_csv(identifier: Identified, caller: Reader, services: ServicesOf) -> Response:
    """The metrics as CSV: a row per drive, one per cell, and one for all."""
    evaluation_for(services, caller, identifier, Aspect.RECORDS)
    return Response(as_csv(_entry(services, identifier)), media_type="text/csv")


@router.get(
    "/v1/evaluations/{identifier}/infractions", response_model=InfractionsView, responses=problems(403, 404, 409)
)
@heavy_read
def get_evaluation_infractions(
    identifier: Identified, caller: Reader, services: ServicesOf, readers: ReadersOf
) -> Response:
    """Infractions of all finished episodes with their positions, for a map; 409 where nobody drives on roads."""
    _, benchmark = evaluation_for(services, caller, identifier, Aspect.REPLAYS)
    networks = {cell.name: cell.network for cell in readers.benchmark(benchmark).cells}
    found = [
        InfractionView(
            **mark,
            network=networks.get(drive.cell, ""),
            episode=drive.episode,
            scenario=drive.scenario,
            cell=drive.cell,
            seed=drive.seed,
            ego=drive.facts["name"],
        )
        for drive in _entry(services, identifier).drives
        for mark in drive.facts["marks"]
    ]
    view = InfractionsView(evaluation=identifier, networks=list(dict.fromkeys(networks.values())), infractions=found)
    return Response(view.model_dump_json(), media_type="application/json")


def _entry(services: Services, identifier: str) -> Entry:
    with services.database.reading() as session:
        entry = reading.entries(session, [identifier]).get(identifier)
    if entry is None:  # it was deleted since the caller's right to it was checked
        raise NotFoundError(f"no evaluation '{identifier}'")
    return entry
