"""Health checks for supervisors and load balancers."""

from __future__ import annotations

from functools import partial
from typing import Any

from fastapi import APIRouter
from fastapi.responses import JSONResponse
from sqlalchemy.exc import SQLAlchemyError

from dohyo.service.confinement.layers import layers
from dohyo.service.errors import problem
from dohyo.service.monitoring.room import lack_of_room
from dohyo.service.state import ServicesOf
from dohyo.service.web.documents import problems
from dohyo.service.web.own_threads import OwnThreads

_THREADS = OwnThreads("health checks", 4)

router = APIRouter(prefix="/health", tags=["health"], responses=problems())


@router.get("/live")
async def get_liveness() -> dict[str, str]:
    """Liveness: the process answers."""
    return {"status": "alive"}


@router.get("/ready", response_model=None, responses={200: {"content": {"application/json": {}}}})
async def get_readiness(services: ServicesOf) -> dict[str, Any] | JSONResponse:
    """Readiness: the database answers, is locked by this server, orders can be stored, and no shutdown has begun."""
    if services.draining:
        return problem(503, "the service is shutting down", {"retry-after": "30"})
    if services.database.fenced:
        return problem(503, "this server has lost its lock on the database", {"retry-after": "5"})
    try:
        await _THREADS.run(services.database.check)
    except SQLAlchemyError:
        return problem(503, "the database does not answer", {"retry-after": "5"})
    if lack := await _THREADS.run(partial(lack_of_room, services.settings.data)):
        return problem(503, lack, {"retry-after": "60"})
    return {
        "status": "ready",
        "started": services.started.isoformat(),
        "episodes": services.scheduler.snapshot(),
        "confinement": await _THREADS.run(layers),
    }
