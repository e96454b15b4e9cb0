"""Health checks for supervisors and load balancers."""

from __future__ import annotations

from typing import Any

from anyio import CapacityLimiter, to_thread
from fastapi import APIRouter
from fastapi.responses import JSONResponse
from sqlalchemy.exc import SQLAlchemyError

from dohyo.service.confinement.layers import layers
from dohyo.service.errors import problem
from dohyo.service.monitoring.room import lack_of_room
from dohyo.service.state import ServicesOf
from dohyo.service.web.documents import problems

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
        # Threads of its own: the others may all be busy with long requests.
        await to_thread.run_sync(services.database.check, limiter=CapacityLimiter(1))
    except SQLAlchemyError:
        return problem(503, "the database does not answer", {"retry-after": "5"})
    data = services.settings.data
    if lack := await to_thread.run_sync(lack_of_room, data, limiter=CapacityLimiter(1)):
        return problem(503, lack, {"retry-after": "60"})
    return {
        "status": "ready",
        "started": services.started.isoformat(),
        "episodes": services.scheduler.snapshot(),
        "confinement": await to_thread.run_sync(layers, limiter=CapacityLimiter(1)),
    }
