"""Heavy reads: few at once, paid by each caller in processor seconds, and nobody else waits for them."""

from __future__ import annotations

import asyncio
import socket
import threading
import time
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import httpx
import pytest

from dohyo.service.episodes.explanations import Trace
from dohyo.service.episodes.kinds import trace_path
from dohyo.service.errors import BusyError, TooManyRequestsError
from dohyo.service.web import heavy
from dohyo.service.web.heavy import HeavyWork
from tests.evaluation.builders import ego, episode
from tests.service.harness import assert_problem, running
from tests.service.served import PATIENCE_S, Service
from tests.service.shop import Shop


def burn() -> int:
    """About 20 ms of a processor."""
    return sum(number * number for number in range(400_000))


def test_an_empty_purse_is_refused_until_it_is_refilled() -> None:
    clock = [0.0]
    reads = HeavyWork("reads", 0.001, clock=lambda: clock[0])

    async def run() -> None:
        await reads.compute(burn, "address a", True)
        with pytest.raises(TooManyRequestsError) as refused:
            await reads.compute(burn, "address a", True)
        assert int(refused.value.headers["retry-after"]) >= 1
        await reads.compute(burn, "address b", True)
        clock[0] += 1e9
        await reads.compute(burn, "address a", True)

    asyncio.run(run())


def test_anonymous_callers_leave_a_thread_to_those_with_a_token() -> None:
    reads, free = HeavyWork("reads", 60.0), threading.Event()

    async def run() -> None:
        held = [asyncio.create_task(reads.compute(lambda: free.wait(60), f"address {n}", True)) for n in range(5)]
        await asyncio.sleep(0)
        assert await reads.compute(lambda: 7, "owner team", False) == 7
        free.set()
        assert all(await asyncio.gather(*held))

    asyncio.run(run())


def test_a_read_that_fails_is_paid_for_and_a_long_queue_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(heavy, "MOST_WAITING", 1)
    reads, free = HeavyWork("reads", 0.001), threading.Event()

    def fail() -> None:
        burn()
        raise ValueError("no such road")

    async def run() -> None:
        with pytest.raises(ValueError, match="no such road"):
            await reads.compute(fail, "owner a", False)
        with pytest.raises(TooManyRequestsError):
            await reads.compute(burn, "owner a", False)
        held = asyncio.create_task(reads.compute(lambda: free.wait(60), "owner b", False))
        await asyncio.sleep(0)
        with pytest.raises(BusyError):
            await reads.compute(burn, "owner c", False)
        free.set()
        await held

    asyncio.run(run())


def test_callers_without_a_token_take_no_place_of_those_with_one(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(heavy, "MOST_WAITING", 4)
    reads, free = HeavyWork("reads", 60.0), threading.Event()

    async def run() -> None:
        held = [asyncio.create_task(reads.compute(lambda: free.wait(60), f"address {n}", True)) for n in range(4)]
        await asyncio.sleep(0)
        with pytest.raises(BusyError):
            await reads.compute(burn, "address 5", True)
        assert await reads.compute(lambda: 7, "owner team", False) == 7
        free.set()
        await asyncio.gather(*held)
        assert await reads.compute(lambda: 8, "address 5", True) == 8

    asyncio.run(run())


def test_a_caller_with_many_reads_delays_another_by_one(monkeypatch: pytest.MonkeyPatch) -> None:
    """And has no more than its share of those that wait."""
    monkeypatch.setattr(heavy, "MOST_WAITING_PER_CALLER", 20)
    reads, free, ended = HeavyWork("reads", 60.0), threading.Event(), list[str]()

    async def read(payer: str) -> None:
        await reads.compute(lambda: free.wait(60), payer, True)
        ended.append(payer)

    async def run() -> None:
        greedy = [asyncio.create_task(read("address a")) for _ in range(20)]
        await asyncio.sleep(0)
        with pytest.raises(TooManyRequestsError, match="at most 20"):
            await read("address a")
        others = [asyncio.create_task(read(f"address {name}")) for name in "bc"]
        await asyncio.sleep(0)
        free.set()
        await asyncio.gather(*greedy, *others)

    asyncio.run(run())
    assert ended[:3] == ["address a", "address b", "address c"]


def test_a_reader_pays_for_boards_tables_records_and_explanations(shop: Shop) -> None:
    evaluation, (one,) = shop.evaluation(shop.submission("made"), [episode(ego())])
    paths = [f"/v1/leaderboard{suffix}?benchmark=made" for suffix in ("", ".csv")]
    paths += [f"/v1/evaluations/{evaluation}/{what}" for what in ("metrics", "metrics.csv", "infractions")]
    paths += [f"/v1/episodes/{one}/{what}" for what in ("record", "trajectory", "events", "explanation?tick=0")]
    trace = Trace()
    trace.noter("ego")({"why": "a pedestrian"})
    trace.write(trace_path(shop.path(one)))
    for path in paths:
        shop.services.reads = HeavyWork("reads", 1e-9)
        answers = [shop.client.get(path), shop.client.get(path), shop.client.get(path, headers=shop.token("ann"))]
        assert [answer.status_code for answer in answers] == [200, 429, 200], path
        assert int(answers[1].headers["retry-after"]) > 0


def test_an_owner_pays_for_orders(tmp_path: Path) -> None:
    with running(tmp_path / "data") as service:
        greedy, modest = service.caller("greedy"), service.caller("modest")
        greedy.agent("a")
        modest.agent("b")
        service.services.orders = HeavyWork("orders", 1e-9)
        greedy.evaluation("a")
        refused = greedy.post("/v1/evaluations", {"agent": "a", "benchmark": "quickstart"})
        assert_problem(refused, 429, "of computing a minute")
        assert int(refused.headers["retry-after"]) > 0
        modest.evaluation("b")


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    shared = Service(
        tmp_path_factory.mktemp("data"), read_seconds_per_minute=0.2, requests_per_minute=100_000, processes=1
    )
    shared.start()
    yield shared
    shared.close()


def test_maps_of_boxes_that_nobody_asked_for_before_keep_nobody_waiting(service: Service) -> None:
    with httpx.Client(base_url=service.url, timeout=120.0, limits=httpx.Limits(max_connections=100)) as client:

        def draw(number: int) -> httpx.Response:
            box = {"x0": -10_000.0 - number, "y0": -10_000, "x1": 10_000, "y1": 10_000}
            return client.get("/v1/networks/ingolstadt/map", params=box)

        me = {"authorization": f"Bearer {service.submitter_token}"}
        # The first look at a network parses it and compiles kernels, which is not what is attacked here.
        assert client.get("/v1/networks/ingolstadt/map", headers=me).status_code == 200
        asked = 0
        with ThreadPoolExecutor(40) as threads:
            sent = [threads.submit(draw, number) for number in range(120)]
            while not all(one.done() for one in sent):
                assert client.get("/v1/me", headers=me).json()["owner"] == "owner"
                assert client.get("/health/ready").status_code == 200
                asked += 1
        answers = [one.result() for one in sent]
        statuses = Counter(answer.status_code for answer in answers)
        assert set(statuses) == {200, 429}, statuses
        assert asked > 0


def begun(service: Service, length: int, token: str = "") -> socket.socket:
    """A connection on which a request has come, except its body."""
    one = socket.create_connection(("127.0.0.1", service.port), timeout=PATIENCE_S)
    about = f"host: x\r\ncontent-type: application/json\r\ncontent-length: {length}\r\n"
    allowed = f"authorization: Bearer {token}\r\n" if token else ""
    one.sendall(f"POST /v1/evaluations HTTP/1.1\r\n{about}{allowed}\r\n".encode())
    return one


def test_a_caller_without_a_token_is_answered_before_its_body_comes(service: Service) -> None:
    for token in ("", "dohyo_nobody"):
        with begun(service, 1_000_000, token) as one:
            assert one.recv(100).startswith(b"HTTP/1.1 401")


def wait_beside_long_bodies(service: Service) -> float:
    """How long a look at the service's health takes while long bodies come, s."""
    body = b"[" + b"1.5," * 300_000 + b"1]"
    many = [begun(service, len(body), service.submitter_token) for _ in range(20)]
    for one in many:
        one.sendall(body[:-1])
    time.sleep(1.0)
    for one in many:
        one.sendall(body[-1:])
    began = time.monotonic()
    assert httpx.get(f"{service.url}/health/live", timeout=120.0).status_code == 200
    waited_s = time.monotonic() - began
    statuses = [one.recv(12)[-3:] for one in many]
    for one in many:
        one.close()
    assert set(statuses) <= {b"422", b"429"}
    return waited_s


def test_long_bodies_that_come_at_once_keep_nobody_waiting(service: Service) -> None:
    """A busy machine may delay one look or the other, but not each of five."""
    assert any(wait_beside_long_bodies(service) < 2.0 for _ in range(5))
