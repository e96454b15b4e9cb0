"""The service in this process, with a scheduler that drives nothing: what it was asked for can be read."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import timedelta
from functools import cache
from pathlib import Path
from typing import Any
from uuid import uuid4

from fastapi import FastAPI
from fastapi.testclient import TestClient
from sqlalchemy import update

from dohyo.service.accounts.model import Role
from dohyo.service.accounts.queries import create_token
from dohyo.service.app import create_app
from dohyo.service.database.base import now
from dohyo.service.database.engine import Database
from dohyo.service.evaluations.model import Episode, EpisodeStatus, Evaluation, EvaluationStatus
from dohyo.service.settings import Settings
from dohyo.service.state import Broadcast, Services
from dohyo.service.workers.leases import LeaseBook
from tests.service.tables import sqlite_with_tables

LONGEST_JOB_S = 300.0
PASSWORD_OF_NOBODY = "dohyo_" + "A" * 43


class IdleScheduler:
    """Takes orders, and drives nothing."""

    def __init__(self, settings: Settings, database: Database, events: Broadcast) -> None:
        self.database, self.events = database, events
        self.leases = LeaseBook(settings.lease_ttl_s)
        self.calls: list[str] = []

    async def start(self) -> None:
        self.calls.append("start")

    async def stop(self) -> None:
        self.calls.append("stop")

    def wake(self) -> None:
        self.calls.append("wake")

    async def cancel(self, evaluation_id: str) -> None:
        self.calls.append(f"cancel {evaluation_id}")
        finish(self.database, evaluation_id, EvaluationStatus.CANCELLED, EpisodeStatus.CANCELLED)

    def snapshot(self) -> dict[str, Any]:
        return {"running": 0, "queued": 0, "processes": 0, "workers": 0, "leases": 0}


def finish(database: Database, evaluation_id: str, status: EvaluationStatus, episodes: EpisodeStatus) -> None:
    """Ends an evaluation and all its episodes that have not ended."""
    with database.session() as session:
        open_ones = (EpisodeStatus.QUEUED, EpisodeStatus.RUNNING)
        which = (Episode.evaluation_id == evaluation_id, Episode.status.in_(open_ones))
        session.execute(update(Episode).where(*which).values(status=episodes))
        session.execute(update(Evaluation).where(Evaluation.id == evaluation_id).values(status=status, finished=now()))


class Harness:
    """A running app and its callers.

    Attributes:
        client: Without a token.
        services: Of the app.
    """

    def __init__(self, client: TestClient, services: Services) -> None:
        self.client, self.services = client, services

    @property
    def scheduler(self) -> IdleScheduler:
        return self.services.scheduler  # type: ignore[return-value]

    def token(self, owner: str, role: Role = Role.SUBMITTER, expires_in: timedelta | None = None) -> str:
        with self.services.database.session() as session:
            return create_token(session, owner, role, expires_in)[1]

    def caller(self, owner: str, role: Role = Role.SUBMITTER) -> Caller:
        return Caller(self.client, self.token(owner, role))


class Caller:
    """Sends requests with one token."""

    def __init__(self, client: TestClient, token: str) -> None:
        self.client, self.headers = client, {"authorization": f"Bearer {token}"}

    def get(self, path: str, **options: Any) -> Any:
        return self._send("GET", path, **options)

    def post(self, path: str, json: Any = None, **options: Any) -> Any:
        return self._send("POST", path, json=json, **options)

    def delete(self, path: str, **options: Any) -> Any:
        return self._send("DELETE", path, **options)

    def agent(self, name: str, **settings: Any) -> None:
        """Registers an agent with one remote submission."""
        assert self.post("/v1/agents", {"name": name}).status_code == 201
        answer = self.post(f"/v1/agents/{name}/submissions", {"kind": "remote", "settings": settings})
        assert answer.status_code == 201, answer.text

    def evaluation(self, agent: str, benchmark: str = "quickstart", **order: Any) -> str:
        answer = self.post("/v1/evaluations", {"agent": agent, "benchmark": benchmark, **order})
        assert answer.status_code == 201, answer.text
        identifier: str = answer.json()["id"]
        return identifier

    def _send(self, method: str, path: str, headers: dict[str, str] | None = None, **options: Any) -> Any:
        def send(prefer: dict[str, str]) -> Any:
            return self.client.request(method, path, headers=self.headers | prefer | (headers or {}), **options)

        return patiently(send) if method == "POST" else send({})


def patiently(send: Callable[[dict[str, str]], Any]) -> Any:
    """The answer to an order, once its job has ended: sent again with these headers, it waits for the same job."""
    prefer, until = {"prefer": "wait=30", "idempotency-key": uuid4().hex}, time.monotonic() + LONGEST_JOB_S
    while is_unfinished_job(answer := send(prefer)) and time.monotonic() < until:
        continue
    return answer


def is_unfinished_job(answer: Any) -> bool:
    """Whether an order takes longer than a request may wait."""
    return bool(answer.status_code == 202 and answer.headers.get("location", "").startswith("/v1/jobs/"))


@cache
def routes_of_all() -> list[Any]:
    """The routes of every app: FastAPI analyses them at the first request, which takes longer than most tests."""
    return create_app(Settings(_env_file=None), IdleScheduler).router.routes


def app_of(settings: Settings) -> FastAPI:
    """A service of its own, with the routes of all."""
    app = create_app(settings, IdleScheduler)
    app.router.routes[:] = routes_of_all()
    return app


@contextmanager
def running(data: Path, **settings: Any) -> Iterator[Harness]:
    """A service on a folder, until the end of the block."""
    given = Settings(data=data, **{"requests_per_minute": 100_000, "_env_file": None} | settings)
    if given.database is None and not data.exists():
        sqlite_with_tables(data / "dohyo.db")
    app = app_of(given)
    with TestClient(app, raise_server_exceptions=False) as client:
        yield Harness(client, app.state.services)


def assert_problem(answer: Any, status: int, *words: str) -> None:
    """It is a problem document of a status, whose detail has these words."""
    assert answer.status_code == status, answer.text
    assert answer.headers["content-type"] == "application/problem+json"
    body = answer.json()
    assert body["status"] == status
    assert body["type"] == "about:blank"
    for word in words:
        assert word in body["detail"], body
