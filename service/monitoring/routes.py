"""Metrics: of an evaluation as JSON, CSV and places on the map; of the service for Prometheus."""

from __future__ import annotations

import platform
from collections.abc import Iterator, Mapping
from importlib.metadata import version
from typing import Any

import msgspec
from fastapi import APIRouter, Response

from dohyo.service.accounts.access import Reader
from dohyo.service.boards import queries as reading
from dohyo.service.boards.leaderboard import Entry
from dohyo.service.episodes.readers import Readers, ReadersOf, evaluation_for
from dohyo.service.episodes.reading_views import InfractionsView, InfractionView
from dohyo.service.evaluations.access import Aspect
from dohyo.service.evaluations.metrics import as_csv, as_document
from dohyo.service.evaluations.metrics_views import MetricsView
from dohyo.service.monitoring.prometheus import CONTENT_TYPE, Family, Sample, exposition
from dohyo.service.state import Services, ServicesOf
from dohyo.service.web.caching import Identified
from dohyo.service.web.documents import problems

router = APIRouter(tags=["metrics"], responses=problems())
CSV: dict[int | str, dict[str, Any]] = {
    200: {"description": "A row per drive and cell.", "content": {"text/csv": {"schema": {"type": "string"}}}}
}
TEXT: dict[int | str, dict[str, Any]] = {
    200: {"description": "Prometheus' text format.", "content": {"text/plain": {"schema": {"type": "string"}}}}
}


@router.get("/v1/evaluations/{identifier}/metrics", response_model=MetricsView, responses=problems(403, 404))
def get_evaluation_metrics(identifier: Identified, caller: Reader, services: ServicesOf) -> Response:
    """Scores with intervals over all finished episodes, by cell, and for every drive."""
    evaluation_for(services, caller, identifier, Aspect.RECORDS)
    document = as_document(_entry(services, identifier))
    return Response(msgspec.json.encode(document), media_type="application/json")


@router.get("/v1/evaluations/{identifier}/metrics.csv", response_class=Response, responses=problems(403, 404) | CSV)
def get_evaluation_metrics_csv(identifier: Identified, caller: Reader, services: ServicesOf) -> Response:
    """The metrics as CSV: a row per drive, one per cell, and one for all."""
    evaluation_for(services, caller, identifier, Aspect.RECORDS)
    return Response(as_csv(_entry(services, identifier)), media_type="text/csv")


@router.get("/v1/evaluations/{identifier}/infractions", response_model=InfractionsView, responses=problems(403, 404))
def get_evaluation_infractions(
    identifier: Identified, caller: Reader, services: ServicesOf, readers: ReadersOf
) -> Response:
    """Infractions of all finished episodes with their positions, for a map."""
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


@router.get("/metrics", response_class=Response, responses=TEXT)
def get_service_metrics(caller: Reader, services: ServicesOf, readers: ReadersOf) -> Response:
    """State of the service for Prometheus; counts from the database are up to five seconds old."""
    return Response(exposition(_families(services, readers)), headers={"content-type": CONTENT_TYPE})


def _entry(services: Services, identifier: str) -> Entry:
    with services.database.reading() as session:
        return reading.entries(session, [identifier])[identifier]


def _families(services: Services, readers: Readers) -> Iterator[Family]:
    build = {"version": version("dohyo"), "sumo": version("libsumo"), "python": platform.python_version()}
    yield Family("dohyo_build_info", "What runs.", "gauge", (Sample(1.0, build),))
    started = services.started.timestamp()
    yield Family("dohyo_start_time_seconds", "When it started.", "gauge", (Sample(started),))
    episodes, evaluations = readers.counts(services)
    yield Family("dohyo_episodes", "Episodes by status.", "gauge", _by_status(episodes))
    yield Family("dohyo_evaluations", "Evaluations by status.", "gauge", _by_status(evaluations))
    yield from _scheduled(services.scheduler.snapshot())


def _by_status(counts: Mapping[str, int]) -> tuple[Sample, ...]:
    return tuple(Sample(count, {"status": status}) for status, count in sorted(counts.items()))


def _scheduled(snapshot: Mapping[str, Any]) -> Iterator[Family]:
    """Gauges of the scheduler's facts: a number is one gauge, numbers by name are one gauge with a label."""
    for name, value in snapshot.items():
        if isinstance(value, bool | int | float):
            yield Family(f"dohyo_scheduler_{name}", f"Of the scheduler: {name}.", "gauge", (Sample(value),))
        elif isinstance(value, Mapping) and all(isinstance(one, int | float) for one in value.values()):
            samples = tuple(Sample(one, {"of": str(key)}) for key, one in value.items())
            yield Family(f"dohyo_scheduler_{name}", f"Of the scheduler: {name}.", "gauge", samples)
