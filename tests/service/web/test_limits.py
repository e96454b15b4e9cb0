from __future__ import annotations

import asyncio
import errno
import os
import sqlite3
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest
from sqlalchemy.exc import OperationalError
from starlette.testclient import TestClient

from dohyo.service.logs import JsonLines
from dohyo.service.monitoring.metrics import Metrics
from dohyo.service.settings import Settings
from dohyo.service.web import limits
from dohyo.service.web.limits import AccessLog, RateLimit
from tests.service.harness import PASSWORD_OF_NOBODY, Caller, Harness, assert_problem, running


@pytest.fixture
def no_refill(monkeypatch: pytest.MonkeyPatch) -> None:
    """The clock of the rates stands still, so that a slow machine is allowed no request more."""
    monkeypatch.setattr(RateLimit.__init__, "__defaults__", (lambda: 0.0, 10_000))


@pytest.mark.parametrize("path", ["/v1/agents", "/v1/agents/a/submissions", "/v1/evaluations", "/v1/webhooks"])
def test_a_body_that_is_too_large_is_refused_by_what_it_says_and_by_what_comes(tmp_path: Path, path: str) -> None:
    with running(tmp_path / "data", body_limit_bytes=2000) as service:
        team = service.caller("team")
        told = team.post(path, content=b"x" * 2001, headers={"content-type": "application/json"})
        assert_problem(told, 413, "2000 bytes")

        def endless() -> Iterator[bytes]:
            for _ in range(10_000):
                yield b" " * 1000

        untold = team.post(path, content=endless(), headers={"content-type": "application/json"})
        assert_problem(untold, 413, "2000 bytes")
        fits = team.post(path, content=b" " * 2000, headers={"content-type": "application/json"})
        assert fits.status_code in (400, 422)


def test_a_wrong_content_length_is_not_believed(tmp_path: Path) -> None:
    with running(tmp_path / "data", body_limit_bytes=2000) as service:
        headers = service.caller("team").headers | {"content-type": "application/json", "content-length": "10"}
        assert_problem(service.client.post("/v1/agents", content=b"x" * 5000, headers=headers), 413)


def test_uploads_have_their_own_limit(tmp_path: Path) -> None:
    with running(tmp_path / "data", body_limit_bytes=2000, upload_limit_bytes=200_000) as service:
        team = service.caller("team")
        team.post("/v1/agents", {"name": "a"})
        path = "/v1/agents/a/submissions/onnx"

        def upload(size: int) -> httpx.Response:
            files = {"file": ("p.onnx", b"x" * size)}
            return service.client.post(path, data={"spec": "{}"}, files=files, headers=team.headers)

        assert upload(5000).status_code == 202
        assert_problem(upload(200_001), 413, "200000 bytes")
        assert_problem(upload(1_000_000), 413)


def test_each_token_has_its_own_rate(tmp_path: Path, no_refill: None) -> None:
    with running(tmp_path / "data", requests_per_minute=20) as service:
        one, other = service.caller("one"), service.caller("other")
        statuses = [one.get("/v1/me").status_code for _ in range(30)]
        # The first request counts for the address, until the token is known.
        assert statuses == [200] * 21 + [429] * 9
        refused = one.get("/v1/me")
        assert_problem(refused, 429, "20 requests a minute")
        assert 1 <= int(refused.headers["retry-after"]) <= 60
        assert other.get("/v1/me").status_code == 200


def test_a_token_has_one_rate_however_its_header_is_written(tmp_path: Path, no_refill: None) -> None:
    with running(tmp_path / "data", requests_per_minute=20) as service:
        token = service.token("team")
        headers = [{"authorization": scheme + token} for scheme in ("Bearer ", "bearer ", "BEARER  ", "bEaReR ")]
        statuses = [service.client.get("/v1/me", headers=one).status_code for one in headers * 10]
        assert statuses == [200] * 21 + [429] * 19


def test_guessing_tokens_spends_what_the_address_has_and_disturbs_no_one_else(tmp_path: Path, no_refill: None) -> None:
    with running(tmp_path / "data", requests_per_minute=20) as service:
        known = service.caller("team")
        assert known.get("/v1/me").status_code == 200
        guesses = [
            Caller(service.client, f"{PASSWORD_OF_NOBODY[:-3]}{number:03d}").get("/v1/me").status_code
            for number in range(40)
        ]
        assert guesses.count(401) == 19
        assert guesses[19:] == [429] * 21
        assert known.get("/v1/me").status_code == 200


def test_guessing_on_the_wire_is_slowed_too(tmp_path: Path, no_refill: None) -> None:
    with running(tmp_path / "data", requests_per_minute=20) as service:
        answers = [
            Caller(service.client, f"guess-{number}").post("/v1/leases/l-0/step", {"tick": 0}).status_code
            for number in range(40)
        ]
        assert answers[:10] == [answers[0]] * 10
        assert answers[0] in (401, 404, 410)
        assert answers[-1] == (429 if answers[0] in (401, 404) else 410)


def test_health_checks_are_never_refused(tmp_path: Path) -> None:
    with running(tmp_path / "data", requests_per_minute=1) as service:
        assert {service.client.get("/health/live").status_code for _ in range(50)} == {200}


def test_a_rate_refills_steadily() -> None:
    now = [0.0]
    limit = RateLimit(lambda *_: None, per_minute=60, clock=lambda: now[0], remembered=3)  # type: ignore[arg-type,return-value]
    assert [limit._take("a") for _ in range(60)] == [0.0] * 60
    assert limit._take("a") == pytest.approx(1.0)
    now[0] = 0.5
    assert limit._take("a") == pytest.approx(0.5)
    now[0] = 2.0
    assert [limit._take("a") > 0 for _ in range(3)] == [False, False, True]
    for key in "bcdefg":
        limit._take(key)
    assert len(limit._buckets) == 3  # invented addresses fill no memory


def test_browsers_are_told_to_run_nothing_foreign(service: Harness) -> None:
    for path in ("/", "/v1/benchmarks", "/nowhere", "/static/none.js"):
        headers = service.client.get(path).headers
        policy = dict(part.strip().split(" ", 1) for part in headers["content-security-policy"].split(";"))
        assert policy["default-src"] == "'none'"
        assert policy["script-src"] == "'self'"
        assert policy["frame-ancestors"] == "'none'"
        assert "unsafe" not in headers["content-security-policy"]
        assert headers["x-content-type-options"] == "nosniff"
        assert headers["x-request-id"]


def test_other_origins_get_no_permission_unless_they_are_named(service: Harness, tmp_path: Path) -> None:
    origin = {"origin": "https://elsewhere.example"}
    assert "access-control-allow-origin" not in service.client.get("/v1/benchmarks", headers=origin).headers
    with running(tmp_path / "other", cors_origins=("https://elsewhere.example",)) as open_one:
        answer = open_one.client.get("/v1/benchmarks", headers=origin)
        assert answer.headers["access-control-allow-origin"] == "https://elsewhere.example"
        assert "access-control-allow-credentials" not in answer.headers
        stranger = open_one.client.get("/v1/benchmarks", headers={"origin": "https://third.example"})
        assert "access-control-allow-origin" not in stranger.headers


def test_a_locked_database_is_busy_and_not_broken(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("dohyo.service.database.engine.BUSY_S", 0.2)
    monkeypatch.setattr("dohyo.service.database.engine.Database.__init__.__kwdefaults__", {"busy_s": 0.2, "pool": 20})
    with running(tmp_path / "data") as service:
        team = service.caller("team")
        lock = sqlite3.connect(tmp_path / "data" / "dohyo.db", isolation_level=None)
        lock.execute("BEGIN IMMEDIATE")
        refused = team.post("/v1/agents", {"name": "late"})
        assert_problem(refused, 503, "busy")
        assert int(refused.headers["retry-after"]) > 0
        assert team.get("/v1/agents").status_code == 200  # reading goes on
        lock.execute("ROLLBACK")
        lock.close()
        assert team.post("/v1/agents", {"name": "late"}).status_code == 201


def test_a_full_disk_under_the_database_keeps_nothing(service: Harness, monkeypatch: pytest.MonkeyPatch) -> None:
    team = service.caller("team")
    team.agent("a")

    def full(*_: object) -> None:
        raise OperationalError("COMMIT", {}, sqlite3.OperationalError("database or disk is full"))

    monkeypatch.setattr("dohyo.service.evaluations.routes.remember", full)
    assert_problem(team.post("/v1/evaluations", {"agent": "a", "benchmark": "quickstart"}), 507, "no space")
    monkeypatch.undo()
    assert team.get("/v1/evaluations").json()["items"] == []
    assert service.scheduler.calls == ["start"]


def test_a_full_disk_while_an_upload_comes_in(service: Harness, monkeypatch: pytest.MonkeyPatch) -> None:
    team = service.caller("team")
    team.post("/v1/agents", {"name": "a"})

    async def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr("dohyo.service.web.bodies.uploads._copy", full)
    files = {"file": ("p.onnx", b"x" * 5000)}
    path = "/v1/agents/a/submissions/onnx"
    assert_problem(service.client.post(path, data={"spec": "{}"}, files=files, headers=team.headers), 507)


def test_a_defect_tells_its_name_and_the_log_the_rest(
    service: Harness, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def broken(*_: object, **__: object) -> None:
        raise RuntimeError("password=hunter2")

    monkeypatch.setattr("dohyo.service.submissions.queries.list_agents", broken)
    answer = service.client.get("/v1/agents")
    assert_problem(answer, 500)
    assert "hunter2" not in answer.text
    assert "RuntimeError" not in answer.text
    (logged,) = (record for record in caplog.records if record.name == "dohyo.service" and record.exc_info)
    assert answer.headers["x-request-id"] in logged.getMessage()
    assert "hunter2" in JsonLines().format(logged)


def test_a_request_cancelled_by_the_end_of_the_service_is_told_to_come_again() -> None:
    """A response that has begun cannot be taken back: its connection breaks."""

    async def ask(begun: bool) -> list[Any]:
        sent: list[Any] = []

        async def slow(scope: Any, receive: Any, send: Any) -> None:
            if begun:
                await send({"type": "http.response.start", "status": 200, "headers": []})
            await asyncio.sleep(60)

        async def send(message: Any) -> None:
            sent.append(message)

        scope = {"type": "http", "method": "POST", "path": "/v1/evaluations", "headers": []}
        task = asyncio.create_task(AccessLog(slow, Metrics())(scope, None, send))  # type: ignore[arg-type]
        await asyncio.sleep(0.01)
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)
        return sent

    start, body = asyncio.run(ask(begun=False))
    assert (start["status"], dict(start["headers"])[b"retry-after"]) == (503, b"30")
    assert b"shutting down" in body["body"]
    assert [message.get("status") for message in asyncio.run(ask(begun=True))] == [200]


def test_unknown_addresses_and_methods_are_problems_too(service: Harness) -> None:
    assert_problem(service.client.get("/v1/nothing"), 404)
    assert_problem(service.client.put("/v1/agents"), 405)


def test_two_services_on_one_folder_refuse(tmp_path: Path) -> None:
    from dohyo.service.app import create_app
    from dohyo.sumo_networks.errors import InvalidInputError
    from tests.service.harness import IdleScheduler

    with running(tmp_path / "data"):
        second = create_app(Settings(data=tmp_path / "data"), IdleScheduler)
        with pytest.raises(InvalidInputError, match="in use"), TestClient(second):
            pass
    with running(tmp_path / "data"):
        pass


def test_an_address_redeems_so_many_invitations_a_day(service: Harness, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(limits, "REDEMPTIONS_PER_DAY", 3)
    guess = {"code": "dohyo_invitation_none", "owner": "eve"}
    answers = [service.client.post("/v1/invitations/redeem", json=guess) for _ in range(4)]
    assert [answer.status_code for answer in answers] == [404, 404, 404, 429]
    assert_problem(answers[-1], 429, "3 redemptions a day")
    assert int(answers[-1].headers["retry-after"]) > 3600
    assert service.client.post("/join", data=guess).status_code == 429
    assert service.client.get("/join").status_code == 200
    assert service.caller("team").get("/v1/me").status_code == 200
