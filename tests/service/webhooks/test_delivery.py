from __future__ import annotations

import asyncio
import hashlib
import hmac
import json
import socket
import threading
import time
from collections.abc import Iterator
from datetime import timedelta
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import select

from dohyo.service.database.base import now
from dohyo.service.database.engine import Database
from dohyo.service.evaluations.model import EpisodeStatus, EvaluationStatus
from dohyo.service.webhooks import delivery
from dohyo.service.webhooks import queries as webhooks
from dohyo.service.webhooks.model import Delivery
from dohyo.sumo_networks.errors import InvalidInputError
from tests.service.clock import WrongClock
from tests.service.harness import Harness, assert_problem, finish, running
from tests.service.webhooks.receiver import Dripping, Receiver, deliveries, settled


@pytest.fixture
def receiver() -> Iterator[Receiver]:
    made = Receiver()
    yield made
    made.close()


@pytest.fixture
def telling(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Harness]:
    monkeypatch.setattr(delivery, "POLL_S", 0.02)
    monkeypatch.setattr(webhooks, "FIRST_WAIT", timedelta(seconds=0.02))
    monkeypatch.setattr(webhooks, "ATTEMPTS", 8)
    with running(tmp_path / "data", webhook_private_addresses=True) as harness:
        yield harness


def test_the_end_of_an_evaluation_is_told_signed_and_once(telling: Harness, receiver: Receiver) -> None:
    team, other = telling.caller("team"), telling.caller("other")
    url = f"http://127.0.0.1:{receiver.port}/hook"
    secret = team.post("/v1/webhooks", {"url": url}).json()["secret"]
    other.post("/v1/webhooks", {"url": url})
    team.agent("a")
    evaluation = team.evaluation("a")
    assert deliveries(telling) == []
    finish(telling.services.database, evaluation, EvaluationStatus.DONE, EpisodeStatus.DONE)
    (one,) = settled(telling)
    assert one.attempts == 1
    ((headers, body),) = receiver.got
    told = json.loads(body)
    assert (told["event"], told["evaluation"], told["status"]) == ("evaluation.finished", evaluation, "done")
    assert (told["agent"], told["benchmark"]) == ("a", "quickstart")
    timestamp, given = (part.split("=", 1)[1] for part in headers["dohyo-signature"].split(","))
    assert given == hmac.new(secret.encode(), f"{timestamp}.".encode() + body, hashlib.sha256).hexdigest()
    assert abs(int(timestamp) - time.time()) < 30
    assert headers["dohyo-delivery"] == one.id


def test_a_resumed_evaluation_is_told_again_when_it_ends_again(telling: Harness, receiver: Receiver) -> None:
    team = telling.caller("team")
    team.post("/v1/webhooks", {"url": f"http://127.0.0.1:{receiver.port}"})
    team.agent("a")
    evaluation = team.evaluation("a")
    team.post(f"/v1/evaluations/{evaluation}/cancel")
    receiver.wait(1)
    team.post(f"/v1/evaluations/{evaluation}/resume")
    finish(telling.services.database, evaluation, EvaluationStatus.DONE, EpisodeStatus.DONE)
    receiver.wait(2)
    assert [json.loads(body)["status"] for _, body in receiver.got] == ["cancelled", "done"]


def test_a_resumed_evaluation_is_told_again_where_the_clock_was_set_back_meanwhile(
    service: Harness, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock, database, team = WrongClock(monkeypatch), service.services.database, service.caller("team")
    team.post("/v1/webhooks", {"url": "https://example.org/hook"})
    team.agent("a")
    evaluation = team.evaluation("a")

    def told(status: EvaluationStatus) -> list[str]:
        finish(database, evaluation, status, EpisodeStatus.CANCELLED)
        with database.session() as session:
            webhooks.announce(session)  # unless the service has done so
        return sorted(one.body["status"] for one in deliveries(service))

    assert told(EvaluationStatus.CANCELLED) == ["cancelled"]
    clock.shift = timedelta(hours=-1)
    assert team.post(f"/v1/evaluations/{evaluation}/resume").status_code == 200
    assert told(EvaluationStatus.DONE) == ["cancelled", "done"]


def test_it_is_tried_again_until_it_is_taken(telling: Harness, receiver: Receiver) -> None:
    receiver.answers = [500, 503, 204]
    team = telling.caller("team")
    team.post("/v1/webhooks", {"url": f"http://127.0.0.1:{receiver.port}"})
    team.agent("a")
    team.post(f"/v1/evaluations/{team.evaluation('a')}/cancel")
    receiver.wait(3)
    (one,) = settled(telling)
    assert (one.attempts, one.failure) == (3, None)
    assert len({headers["dohyo-delivery"] for headers, _ in receiver.got}) == 1


def test_it_is_given_up_after_a_while_or_when_the_receiver_says_gone(telling: Harness, receiver: Receiver) -> None:
    team = telling.caller("team")
    team.post("/v1/webhooks", {"url": f"http://127.0.0.1:{receiver.port}"})
    team.agent("a")
    receiver.answers = [410]
    team.post(f"/v1/evaluations/{team.evaluation('a')}/cancel")
    (one,) = settled(telling)
    assert len(receiver.got) == 1
    assert one.failure == "it answered 410"


def test_redirects_are_not_followed(telling: Harness, receiver: Receiver, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(webhooks, "ATTEMPTS", 1)
    receiver.answers = [302]
    team = telling.caller("team")
    team.post("/v1/webhooks", {"url": f"http://127.0.0.1:{receiver.port}"})
    team.agent("a")
    team.post(f"/v1/evaluations/{team.evaluation('a')}/cancel")
    (one,) = settled(telling)
    assert len(receiver.got) == 1
    assert one.failure == "it answered 302"


@pytest.mark.parametrize(
    "url",
    [
        "http://127.0.0.1/x",
        "http://localhost:8000/",
        "https://sub.localhost/",
        "http://10.1.2.3/",
        "http://192.168.0.1/",
        "http://169.254.169.254/latest/meta-data",
        "http://[::1]/",
        "http://[::ffff:127.0.0.1]/",
        "http://[fe80::1%25eth0]/",
        "http://0.0.0.0/",
        "http://[64:ff9b::7f00:1]/",
        "http://[64:ff9b:1::a00:1]/",
        "http://[2002:7f00:1::]/",
        "http://[2001:0:7f00:1::]/",
        "http://[::10.0.0.1]/",
        "http://[::ffff:0:7f00:1]/",
        "http://[fec0::1]/",
        "http://100.64.0.1/",
        "https://ex ample.org/",
        "https://ex%20ample.org/",
        "http://a..b/",
        "https://.example.org/",
        "https://example.org../",
        "https://" + 64 * "a" + ".org/",
        "https://" + 127 * "a." + "org/",
        "https://user:secret@example.org/",
        "ftp://example.org/",
        "file:///etc/passwd",
        "https://",
        "no address",
        "https://example.org:99999/",
        "https://example.org/\n",
        "https://300.1.1.1/",
        "https://[v1.a]/",
    ],
)
def test_addresses_that_no_webhook_may_have(service: Harness, url: str) -> None:
    team = service.caller("team")
    answer = team.post("/v1/webhooks", {"url": url})
    assert_problem(answer, 422, "webhook")
    assert "secret" not in answer.text
    assert team.get("/v1/webhooks").json()["items"] == []


@pytest.mark.parametrize(
    "url",
    [
        "https://example.org./x",
        "https://a_b.ex-ample.org",
        "https://münchen.example/hook",
        "https://" + 63 * "a" + ".org",
        "http://93.184.215.14:8080/",
        "http://[2606:4700::1111]/",
    ],
)
def test_names_and_public_addresses_of_any_spelling(url: str) -> None:
    delivery.check_url(url, private_allowed=False)


def test_a_public_name_that_leads_inside_is_refused_when_it_is_called(monkeypatch: pytest.MonkeyPatch) -> None:
    async def address_of(answers: list[str]) -> str:
        def getaddrinfo(*_: Any, **__: Any) -> list[Any]:
            return [(2, 1, 6, "", (answer, 443)) for answer in answers]

        monkeypatch.setattr(delivery.socket, "getaddrinfo", getaddrinfo)
        return await delivery.public_address("example.org", 443, private_allowed=False)

    assert asyncio.run(address_of(["93.184.215.14"])) == "93.184.215.14"
    for inside in (
        "127.0.0.1",
        "10.0.0.1",
        "::1",
        "169.254.169.254",
        "::ffff:192.168.1.1",
        "224.0.0.1",
        "fec0::1",
        "::ffff:0:a00:1",
    ):
        with pytest.raises(InvalidInputError, match="not public"):
            asyncio.run(address_of(["93.184.215.14", inside]))


def test_a_delivery_that_fails_by_a_defect_is_settled_and_given_up(
    telling: Harness, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Else it would be due again at once, as fast as the machine can."""

    async def post(*_: object) -> int:
        raise LookupError("a defect")

    monkeypatch.setattr(delivery.Deliverer, "_post", post)
    team = telling.caller("team")
    team.post("/v1/webhooks", {"url": "http://127.0.0.1:9/hook"})
    team.agent("a")
    team.post(f"/v1/evaluations/{team.evaluation('a')}/cancel")
    (one,) = settled(telling)
    assert (one.attempts, one.failure) == (webhooks.ATTEMPTS, "LookupError")


@pytest.mark.parametrize("name", ["due_deliveries", "settle"])
def test_a_defect_beside_the_sending_is_logged_and_ends_no_webhook(
    telling: Harness,
    receiver: Receiver,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
    name: str,
) -> None:
    right, calls = getattr(webhooks, name), iter(range(100))

    def wrong_twice(*args: Any, **options: Any) -> Any:
        if next(calls) < 2:
            raise LookupError("a defect")
        return right(*args, **options)

    monkeypatch.setattr(webhooks, name, wrong_twice)
    team = telling.caller("team")
    team.post("/v1/webhooks", {"url": f"http://127.0.0.1:{receiver.port}/hook"})
    team.agent("a")
    team.post(f"/v1/evaluations/{team.evaluation('a')}/cancel")
    (one,) = settled(telling)
    assert one.failure is None
    logged = [record for record in caplog.records if record.name == "dohyo.webhooks" and record.exc_info]
    assert [record.exc_info[0] for record in logged if record.exc_info] == [LookupError] * 2


def test_each_owner_has_a_few(service: Harness) -> None:
    team = service.caller("team")
    for number in range(10):
        assert team.post("/v1/webhooks", {"url": f"https://example.org/{number}"}).status_code == 201
    assert_problem(team.post("/v1/webhooks", {"url": "https://example.org/11"}), 429, "at most 10")


def test_each_failure_doubles_the_wait(database: Database) -> None:
    with database.session() as session:
        hook = webhooks.add_webhook(session, "team", "https://example.org")
        session.add(Delivery(id="dl-1", webhook_id=hook.id, body={}))
    waits = []
    for _ in range(3):
        with database.session() as session:
            webhooks.settle(session, "dl-1", "it answered 500")
            session.flush()
            waits.append((session.get_one(Delivery, "dl-1").due - now()).total_seconds())
    assert waits == pytest.approx([10, 20, 40], abs=4)
    with database.reading() as session:
        assert webhooks.due_deliveries(session, 10) == []
        assert len(webhooks.due_deliveries(session, 10, at=now() + timedelta(minutes=1))) == 1
    with database.session() as session:
        session.delete(session.get_one(type(hook), hook.id))
    with database.session() as session:
        assert session.scalars(select(Delivery)).all() == []  # gone with its webhook
        webhooks.settle(session, "dl-1", None)


def test_a_message_that_was_stored_while_the_clock_was_ahead_does_not_wait_for_as_long(
    database: Database, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = WrongClock(monkeypatch)
    clock.shift = timedelta(days=30)
    with database.session() as session:
        hook = webhooks.add_webhook(session, "team", "https://example.org")
        session.add(Delivery(id="dl-1", webhook_id=hook.id, body={}))
    clock.shift = timedelta()
    with database.session() as session:
        ((one, _),) = webhooks.due_deliveries(session, 10)
        webhooks.settle(session, one.id, "it answered 500")
        assert webhooks.due_deliveries(session, 10) == []


def test_a_message_is_given_up_after_three_days() -> None:
    waits = [webhooks.wait_after(attempts) for attempts in range(1, webhooks.ATTEMPTS)]
    assert waits == sorted(waits)
    assert max(waits) == timedelta(hours=1)
    assert timedelta(days=3) < sum(waits, timedelta()) < timedelta(days=3, hours=2)


def test_an_owner_sees_whether_messages_are_accepted(telling: Harness, receiver: Receiver) -> None:
    team = telling.caller("team")
    made = team.post("/v1/webhooks", {"url": f"http://127.0.0.1:{receiver.port}"}).json()
    nothing = {"waiting": 0, "given_up": 0, "delivered": None, "failed": None, "failure": None}
    assert {key: made[key] for key in nothing} == nothing

    def listed() -> dict[str, Any]:
        (one,) = team.get("/v1/webhooks").json()["items"]
        assert (one["id"], "secret" in one) == (made["id"], False)
        return {key: one[key] for key in nothing}

    assert listed() == nothing
    team.agent("a")
    receiver.answers = [204, 410]
    began = now().isoformat()
    for count in (1, 2):
        team.post(f"/v1/evaluations/{team.evaluation('a')}/cancel")
        receiver.wait(count)
        settled(telling)
    seen = listed()
    assert (seen["waiting"], seen["given_up"], seen["failure"]) == (0, 1, "it answered 410")
    assert began < seen["delivered"] < seen["failed"] <= now().isoformat()
    with telling.services.database.session() as session:
        later = now() + timedelta(hours=1)
        waiting = {"attempts": 2, "due": later, "failure": "it answered 503"}
        session.add(Delivery(id="dl-2", webhook_id=made["id"], body={}, **waiting))
        session.add(Delivery(id="dl-3", webhook_id=made["id"], body={}, due=later))
    seen = listed()
    assert (seen["waiting"], seen["given_up"], seen["failure"]) == (2, 1, "it answered 503")


def test_old_messages_that_are_done_with_go_with_the_next_one(database: Database) -> None:
    """The table would grow for as long as evaluations end."""
    old, recent = now() - timedelta(days=15), now() - timedelta(days=13)
    with database.session() as session:
        hook, other = (webhooks.add_webhook(session, "team", f"https://example.org/{number}") for number in (1, 2))
        rows = {
            "delivered": {"due": old, "delivered": old},
            "given-up": {"due": old, "attempts": webhooks.ATTEMPTS},
            "waiting": {"due": old, "attempts": 1},
            "recent": {"due": recent, "delivered": recent},
            "now": {},
        }
        for name, values in rows.items():
            session.add(Delivery(id=name, webhook_id=hook.id, body={}, **values))
        session.add(Delivery(id="of-another", webhook_id=other.id, body={}, due=old, delivered=old))
    with database.session() as session:
        webhooks.settle(session, "now", None)
    with database.reading() as session:
        assert set(session.scalars(select(Delivery.id))) == {"waiting", "recent", "now", "of-another"}


def test_a_receiver_that_drips_delays_only_its_own_messages(
    telling: Harness, receiver: Receiver, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(delivery, "TIMEOUT_S", 5.0)
    monkeypatch.setattr(webhooks, "ATTEMPTS", 1)
    team, other = telling.caller("team"), telling.caller("other")
    with Dripping(b"", b"HTTP/1.1 200 OK\r\n", b"HTTP/1.1 100 Continue\r\n\r\n") as dripping:
        # More than were sent at once before, so that they would hold every other message.
        for _ in range(9):
            team.post("/v1/webhooks", {"url": f"http://127.0.0.1:{dripping.port}/"})
        team.agent("a")
        team.post(f"/v1/evaluations/{team.evaluation('a')}/cancel")
        dripping.wait(9)
        for caller in (team, other):
            caller.post("/v1/webhooks", {"url": f"http://127.0.0.1:{receiver.port}/{caller is team}"})
        other.agent("b")
        for _ in range(2):
            other.post(f"/v1/evaluations/{other.evaluation('b')}/cancel")
            team.post(f"/v1/evaluations/{team.evaluation('a')}/cancel")
        receiver.wait(4)
        assert {one.failure for one in settled(telling)} == {None, "no answer within 5 s"}


def test_a_slow_name_server_holds_no_thread_of_the_service(
    telling: Harness, receiver: Receiver, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(delivery, "TIMEOUT_S", 1.0)
    answer, real = threading.Event(), socket.getaddrinfo

    def slow(host: str, *given: Any, **options: Any) -> Any:
        if host == "slow.example.org":
            answer.wait(120)
        return real(host, *given, **options)

    monkeypatch.setattr(delivery.socket, "getaddrinfo", slow)
    team = telling.caller("team")
    for _ in range(9):
        team.post("/v1/webhooks", {"url": "http://slow.example.org/"})
    team.post("/v1/webhooks", {"url": f"http://127.0.0.1:{receiver.port}/"})
    team.agent("a")
    for _ in range(4):
        team.post(f"/v1/evaluations/{team.evaluation('a')}/cancel")
    receiver.wait(4)
    answer.set()
