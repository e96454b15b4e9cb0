"""The FastAPI application with all its parts."""

from __future__ import annotations

import logging
from collections.abc import AsyncIterator, Callable
from contextlib import AsyncExitStack, asynccontextmanager
from importlib.metadata import version
from typing import Any

from anyio import to_thread
from fastapi import Depends, FastAPI
from fastapi.middleware.cors import CORSMiddleware

from dohyo.service import errors
from dohyo.service.accounts import routes as tokens
from dohyo.service.benchmarks import routes as benchmarks
from dohyo.service.boards import comparison_routes as comparison
from dohyo.service.boards import routes as leaderboard
from dohyo.service.challenges import closing
from dohyo.service.challenges import invitation_routes as invitations
from dohyo.service.challenges import routes as challenges
from dohyo.service.confinement.layers import prepare_confinement
from dohyo.service.dashboard import challenge_pages, pages
from dohyo.service.dashboard.session import SessionCookie, show_errors_as_pages
from dohyo.service.data_folder import held, told
from dohyo.service.database.engine import Database
from dohyo.service.database.server_lock import server_lock
from dohyo.service.episodes import routes as episodes
from dohyo.service.evaluations import metrics_routes as metrics
from dohyo.service.evaluations import rescoring_routes as rescoring
from dohyo.service.evaluations import routes as evaluations
from dohyo.service.jobs import routes as jobs
from dohyo.service.jobs.kinds import KINDS
from dohyo.service.league import routes as league
from dohyo.service.mixed_runs import routes as cross_play
from dohyo.service.monitoring import health_routes as health
from dohyo.service.monitoring import routes as service_metrics
from dohyo.service.networks import routes as networks
from dohyo.service.periodic import repeated
from dohyo.service.scheduling.scheduler import Scheduler
from dohyo.service.settings import Settings
from dohyo.service.signing import routes as signing
from dohyo.service.spectating import routes as spectating
from dohyo.service.state import Broadcast, Services
from dohyo.service.storage import retention
from dohyo.service.submissions import agent_routes as agents
from dohyo.service.submissions import builtin_routes as builtin_agents
from dohyo.service.submissions import observation_routes as observations
from dohyo.service.submissions import routes as submissions
from dohyo.service.web import limits
from dohyo.service.web.documents import DESCRIPTION, SUMMARY, TAGS, describe, operation_id, problems
from dohyo.service.web.head import HeadAsGet
from dohyo.service.web.parameters import refuse_unknown
from dohyo.service.web.proxies import TrustedProxies
from dohyo.service.webhooks import routes as webhooks
from dohyo.service.webhooks.delivery import Deliverer
from dohyo.service.workers import routes as workers
from dohyo.service.worlds import guest_routes as guests
from dohyo.service.worlds import routes as worlds
from dohyo.service.worlds import seat_routes as seats

ROUTERS = tuple(
    module.router
    for module in (
        *(health, tokens, jobs, networks, benchmarks, observations, builtin_agents, agents, submissions),
        *(
            evaluations,
            episodes,
            leaderboard,
            league,
            cross_play,
            comparison,
            challenges,
            invitations,
            metrics,
            rescoring,
        ),
        *(webhooks, workers, worlds, guests, seats, spectating, signing, service_metrics),
    )
)

logger = logging.getLogger("dohyo.service")


def create_app(
    settings: Settings | None = None,
    make_scheduler: Callable[[Settings, Database, Broadcast], Any] = Scheduler,
) -> FastAPI:
    """Creates the service; its parts start with the app's lifespan.

    Args:
        settings: Settings of the service; None reads them from the environment.
        make_scheduler: Factory of the scheduler that drives episodes.
    """
    settings = settings or Settings()
    database, events = Database(settings.database_url), Broadcast()
    app = FastAPI(
        title="dohyo",
        summary=SUMMARY,
        description=DESCRIPTION,
        servers=[{"url": "/", "description": "The service that this document was read from."}],
        version=version("dohyo"),
        openapi_tags=TAGS,
        docs_url=None,
        redoc_url=None,
        lifespan=_lifespan,
        responses=problems(),
        generate_unique_id_function=operation_id,
    )
    app.state.services = Services(settings, database, make_scheduler(settings, database, events), events)
    app.state.league = settings.league  # the pages' navigation shows it
    errors.install(app)
    app.router.routes.insert(0, workers.step_route)
    for router in ROUTERS:
        app.include_router(router, dependencies=[Depends(refuse_unknown)])
    describe(app)
    app.include_router(pages.router)
    app.include_router(challenge_pages.router)
    app.mount("/static", pages.static, name="static")
    show_errors_as_pages(app, pages.render)
    _add_layers(app, app.state.services)
    return app


def _add_layers(app: FastAPI, services: Services) -> None:
    """Each added layer is put around those before."""
    settings = services.settings
    app.add_middleware(limits.BodyLimit, limit=settings.body_limit_bytes, upload_limit=settings.upload_limit_bytes)
    app.add_middleware(limits.RateLimit, per_minute=settings.requests_per_minute)
    app.add_middleware(SessionCookie)
    if settings.cors_origins:
        app.add_middleware(
            CORSMiddleware,
            allow_origins=list(settings.cors_origins),
            allow_methods=["GET", "POST", "PATCH", "DELETE"],
            allow_headers=["authorization", "content-type", "idempotency-key", "prefer"],
        )
    app.add_middleware(limits.SecurityHeaders, tls=settings.tls_certificate is not None)
    app.add_middleware(HeadAsGet)
    app.add_middleware(limits.AccessLog, metrics=services.metrics)
    app.add_middleware(TrustedProxies, trusted=settings.trusted_proxies)


@asynccontextmanager
async def _lifespan(app: FastAPI) -> AsyncIterator[None]:
    services: Services = app.state.services
    async with AsyncExitStack() as stack:
        stack.enter_context(held(services.settings))
        stack.enter_context(told(services.settings))
        services.signing.prepare()
        stack.callback(services.database.close)
        stack.enter_context(server_lock(services.database, lambda: services.lost())).watch()
        await to_thread.run_sync(prepare_confinement)
        deliverer = Deliverer(services)
        await deliverer.start()
        stack.push_async_callback(deliverer.stop)
        for work, every_s, name in (
            (lambda: closing.close_ended(services), closing.EVERY_S, "closing of phases"),
            (retention.Retention(services).remove, retention.EVERY_S, "removal of old records"),
        ):
            await stack.enter_async_context(repeated(work, every_s, name))
        stack.push_async_callback(services.drain)
        await services.jobs.start(services, KINDS)
        await services.scheduler.start()
        await services.worlds.start()
        logger.info("ready")
        yield
