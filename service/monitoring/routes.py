"""Metrics of the service for Prometheus."""

from __future__ import annotations

import hmac
import shutil
from collections.abc import Iterator, Mapping
from typing import Any

from fastapi import APIRouter, Depends, Request, Response
from prometheus_client import CONTENT_TYPE_LATEST, CollectorRegistry, generate_latest
from prometheus_client.core import GaugeMetricFamily

from dohyo.service.accounts.access import Credentials, identify
from dohyo.service.accounts.model import Role
from dohyo.service.episodes.readers import Readers, ReadersOf
from dohyo.service.errors import ForbiddenError, UnauthorisedError
from dohyo.service.jobs.queries import count_by_status
from dohyo.service.state import Services, ServicesOf
from dohyo.service.web.documents import problems

TEXT: dict[int | str, dict[str, Any]] = {
    200: {"description": "Prometheus' text format.", "content": {"text/plain": {"schema": {"type": "string"}}}}
}

router = APIRouter(tags=["health"])


async def _check(request: Request, credentials: Credentials, services: ServicesOf) -> None:
    """Lets in administrators and the token of the settings: the counts are of all owners."""
    own = services.settings.metrics_token
    if own is not None and credentials is not None and _same(own.get_secret_value(), credentials.credentials):
        return
    caller = await identify(request, credentials, services)
    if caller is None:
        raise UnauthorisedError()
    if caller.role is not Role.ADMIN:
        raise ForbiddenError(
            f"expected an administrator's token or that of DOHYO_METRICS_TOKEN, yours is {caller.role}"
        )


@router.get("/metrics", response_class=Response, responses=problems(403) | TEXT, dependencies=[Depends(_check)])
def get_service_metrics(services: ServicesOf, readers: ReadersOf) -> Response:
    """The service's metrics for Prometheus; counts from the database are up to five seconds old."""
    now = CollectorRegistry()
    now.register(_Counts(services, readers))
    content = generate_latest(services.metrics.registry) + generate_latest(now)
    return Response(content, headers={"content-type": CONTENT_TYPE_LATEST})


def _same(own: str, sent: str) -> bool:
    return hmac.compare_digest(own.encode(), sent.encode())


class _Counts:
    """What the database and the scheduler count at this moment."""

    def __init__(self, services: Services, readers: Readers) -> None:
        self._services, self._readers = services, readers

    def collect(self) -> Iterator[GaugeMetricFamily]:
        episodes, evaluations = self._readers.counts(self._services)
        with self._services.database.reading() as session:
            jobs = count_by_status(session)
        yield _gauge("dohyo_jobs", "Jobs by status.", jobs, "status")
        yield _gauge("dohyo_start_time_seconds", "Start of the service.", self._services.started.timestamp())
        yield _gauge("dohyo_episodes", "Episodes by status.", episodes, "status")
        yield _gauge("dohyo_evaluations", "Evaluations by status.", evaluations, "status")
        free = shutil.disk_usage(self._services.settings.data).free
        yield _gauge("dohyo_data_free_bytes", "Free bytes of the disk of the data folder.", free)
        for name, value in self._services.scheduler.snapshot().items():
            values = value.values() if isinstance(value, Mapping) else [value]
            if all(isinstance(one, int | float) for one in values):
                yield _gauge(f"dohyo_scheduler_{name}", f"Of the scheduler: {name}.", value, "of")


def _gauge(name: str, text: str, value: float | Mapping[str, float], label: str = "") -> GaugeMetricFamily:
    """One value, or values by a label."""
    if not isinstance(value, Mapping):
        return GaugeMetricFamily(name, text, value=value)
    family = GaugeMetricFamily(name, text, labels=[label])
    for key, one in value.items():
        family.add_metric([str(key)], one)
    return family
