from __future__ import annotations

import asyncio
import threading
from collections.abc import AsyncIterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import httpx

from dohyo.service.database.base import now
from dohyo.service.evaluations.model import EvaluationStatus
from dohyo.service.evaluations.views import EvaluationView, Progress
from dohyo.service.state import BACKLOG, Broadcast
from dohyo.service.submissions.model import AgentKind
from dohyo.service.web import events as web_events
from tests.service.served import Service, wait_until


def state(done: int, status: EvaluationStatus = EvaluationStatus.RUNNING) -> EvaluationView:
    return EvaluationView(
        id="ev-1",
        owner="team",
        agent="a",
        version=1,
        kind=AgentKind.REMOTE,
        track="map",
        egos={},
        benchmark="b",
        benchmark_version="0" * 64,
        dohyo_versions=[],
        seeds=[0],
        slow_policy="wait",
        act_deadline_s=10.0,
        status=status,
        failure=None,
        ranking=None,
        withheld=False,
        progress=Progress(total=9, done=done),
        created=now().replace(microsecond=0),
        started=None,
        finished=None,
    )


async def _collect(events: Broadcast, states: list[EvaluationView], act: Any) -> list[str]:
    async def read() -> EvaluationView:
        return states.pop(0) if len(states) > 1 else states[0]

    stream: AsyncIterator[str] = web_events.stream(events, "evaluation:ev-1", read)
    out = [await anext(stream)]
    await act()
    out += [text async for text in stream]
    return out


def test_a_listener_that_is_too_slow_reads_the_state_again_and_loses_nothing() -> None:
    events = Broadcast()

    async def flood() -> None:
        for number in range(3 * BACKLOG):
            events.publish("evaluation:ev-1", {"episode": f"ep-{number}", "status": "done"})
        events.close()

    ended = state(9, EvaluationStatus.DONE)
    out = asyncio.run(_collect(events, [state(0), ended], flood))
    assert "event: state" in out[0]
    assert "event: end" in out[-1]
    assert '"done":9' in out[-1]


def test_silence_is_filled_with_comments_and_ends_are_noticed_without_a_message(monkeypatch: Any) -> None:
    monkeypatch.setattr(web_events, "HEARTBEAT_S", 0.01)

    async def nothing() -> None:
        return

    same = state(0)
    out = asyncio.run(_collect(Broadcast(), [same, same, same, state(9, EvaluationStatus.FAILED)], nothing))
    assert [text.split("\n")[0] for text in out] == ["retry: 3000", ": still here", ": still here", "event: end"]


def test_the_end_of_the_service_ends_all_streams_also_later_ones() -> None:
    events = Broadcast()

    async def close() -> None:
        events.close()

    assert len(asyncio.run(_collect(events, [state(0)], close))) == 1
    assert len(asyncio.run(_collect(events, [state(0)], close))) == 1


def test_messages_from_other_threads_arrive_in_order() -> None:
    events = Broadcast()

    async def listen() -> list[int]:
        with events.subscribe("numbers") as subscription:
            thread = threading.Thread(target=lambda: [events.publish("numbers", {"n": n}) for n in range(100)])
            thread.start()
            got = [(await subscription.get(120.0) or {})["n"] for _ in range(100)]
            thread.join()
            assert await subscription.get(0.01) is None
            return got

    assert asyncio.run(listen()) == list(range(100))


def test_nobody_listening_is_no_trouble() -> None:
    Broadcast().publish("nothing", {})


def test_a_subscription_ends_its_iteration_when_it_is_closed() -> None:
    events = Broadcast()

    async def listen() -> list[dict[str, Any]]:
        subscription = events.subscribe("t")
        events.publish("t", {"n": 1})
        subscription.close()
        return [message async for message in subscription]

    assert asyncio.run(listen()) == [{"n": 1}]


def test_a_caller_that_opens_streams_without_end_is_refused_and_others_still_get_theirs(tmp_path: Path) -> None:
    service = Service(tmp_path / "data")
    service.start()
    mine, others = ({"authorization": f"Bearer {token}"} for token in (service.submitter_token, service.other_token))
    limits = httpx.Limits(max_connections=100)
    try:
        with httpx.Client(base_url=service.url, timeout=120.0, limits=limits) as http, ExitStack() as opened:
            order = {"kind": "remote"}
            http.post("/v1/agents", json={"name": "a"}, headers=mine).raise_for_status()
            http.post("/v1/agents/a/submissions", json=order, headers=mine).raise_for_status()
            run = http.post("/v1/evaluations", json={"agent": "a", "benchmark": "quickstart"}, headers=mine)
            path = f"/v1/evaluations/{run.raise_for_status().json()['id']}/progress"

            def follow(headers: dict[str, str]) -> httpx.Response:
                return opened.enter_context(http.stream("GET", path, headers=headers))

            streams = [follow(mine) for _ in range(web_events.STREAMS_PER_CALLER)]
            assert {one.status_code for one in streams} == {200}
            refused = follow(mine)
            assert (refused.status_code, refused.headers["content-type"]) == (429, "application/problem+json")
            assert int(refused.headers["retry-after"]) > 0
            assert follow(others).status_code == 200
            assert http.get("/v1/me", headers=mine).status_code == 200
            streams[0].close()
            wait_until(lambda: follow(mine).status_code == 200, "a stream that ended still counts")
    finally:
        service.close()
