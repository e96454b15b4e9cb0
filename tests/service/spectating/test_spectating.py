"""Spectators of a live world: in a real browser, strangers, and one that reads nothing."""

from __future__ import annotations

import json
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import httpx
import pytest
from playwright.sync_api import Browser, Page, expect

from tests.service.browsing import visiting
from tests.service.served import wait_until
from tests.service.serving import Served, serving

ROOT = Path(__file__).parents[3]
WORKER = str(ROOT / "examples" / "world_worker.py")


def street() -> dict[str, object]:
    """Two egos one behind the other on a street of Ingolstadt, without traffic."""
    place = {"lane": "737320747#3_2"}
    goal = {"lane": "737320747#4_2", "position_m": 20.0}
    missions = [
        {"name": name, "start": place | {"position_m": at}, "goal": goal}
        for name, at in (("front", 50.0), ("back", 35.0))
    ]
    return {"name": "street", "network": "ingolstadt", "missions": missions, "traffic": {"warm_up_s": 0.0}}


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    with serving(tmp_path_factory.mktemp("spectating") / "data") as one:
        yield one


@contextmanager
def worker(served: Served, world: str, name: str, ego: str) -> Iterator[None]:
    """The example, in a process of its own, at 1 m/s."""
    process = subprocess.Popen([sys.executable, WORKER, served.url, served.token, world, name, ego, "1.0"])
    try:
        yield
    finally:
        process.kill()
        process.wait()


def speeds(page: Page) -> list[str]:
    return page.locator(".egos .speed").all_inner_texts()


def test_a_spectator_sees_both_egos_move_and_pauses_steps_and_opens_the_replay(
    served: Served, browser: Browser
) -> None:
    world = served.ask("POST", "/v1/worlds", {"scenario": street(), "record": True, "deadline_s": 60})["id"]
    served.ask("POST", f"/v1/worlds/{world}/pause")
    with visiting(browser, served.url) as begin, ExitStack() as workers:
        visit = begin()
        visit.go("/login?next=/worlds")
        visit.page.fill("input[name=token]", served.token)
        visit.page.get_by_role("button", name="sign in").click()
        page = visit.page
        page.get_by_role("link", name=world).click()
        expect(page.locator("[role=status]")).to_contain_text("paused")
        expect(page.locator(".command")).to_contain_text(f"{world} front-driver front")
        for name, ego in (("alice", "front"), ("bob", "back")):
            workers.enter_context(worker(served, world, name, ego))
            expect(page.locator(".egos")).to_contain_text(name)
        expect(page.locator(".clock")).to_have_text("0.0 s")
        before = page.locator("canvas").screenshot()
        page.get_by_role("button", name="10 ticks").click()
        expect(page.locator(".clock")).to_have_text("1.0 s")
        assert [float(speed) > 0.3 for speed in speeds(page)] == [True, True]
        wait_until(lambda: page.locator("canvas").screenshot() != before, "the canvas has not changed")
        page.keyboard.press("ArrowRight")
        expect(page.locator(".clock")).to_have_text("1.1 s")
        page.get_by_role("button", name="resume").click()
        page.get_by_role("button", name="pause").click()
        expect(page.locator("[role=status]")).to_contain_text("paused")
        page.get_by_role("button", name="end", exact=True).click()
        page.get_by_role("link", name="open the replay").click()
        expect(page.locator(".timelines")).to_be_visible()
        assert page.locator("select option").all_inner_texts()[-2:] == ["front", "back"]
        assert visit.complaints == []


def test_a_spectator_sees_the_plan_of_a_driver_and_a_bad_plan_is_refused(served: Served, browser: Browser) -> None:
    world = served.ask("POST", "/v1/worlds", {"scenario": street(), "undriven": "stand", "deadline_s": 60})["id"]
    served.ask("POST", f"/v1/worlds/{world}/pause")
    asked = {"name": "alice", "egos": ["front"], "sensors": ["speedometer"], "control": "lane_command"}
    seat = served.ask("POST", f"/v1/worlds/{world}/join", asked)

    def step(tick: int, plans: object) -> int:
        body = {"tick": tick, "actions": {"front": [0.0, 0.0]}, "plans": plans}
        headers = {"authorization": f"Bearer {seat['token']}"}
        return httpx.post(
            f"{served.url}/v1/seats/{seat['seat']}/step", json=body, headers=headers, timeout=120
        ).status_code

    far = [[2000.0, 0.0]]
    for bad in ({"back": [[1.0, 0.0]]}, {"front": far}, {"front": [[1.0]]}, {"front": [[0.0, 0.0]] * 101}):
        assert step(0, bad) == 422, bad
    with visiting(browser, served.url) as begin:
        visit = begin()
        visit.go(f"/login?next=/worlds/{world}")
        visit.page.fill("input[name=token]", served.token)
        visit.page.get_by_role("button", name="sign in").click()
        served.ask("POST", f"/v1/worlds/{world}/step", {"ticks": 2})
        assert step(0, None) == 200
        expect(visit.page.locator(".clock")).to_have_text("0.1 s")
        visit.page.keyboard.press("f")  # follows the ego, which stands
        visit.page.wait_for_timeout(500)
        before = visit.page.locator("canvas").screenshot()
        assert step(1, {"front": [[2.0 * k, 0.3 * k] for k in range(20)]}) == 200
        expect(visit.page.locator(".clock")).to_have_text("0.2 s")
        wait_until(lambda: visit.page.locator("canvas").screenshot() != before, "the plan is not drawn")
        assert visit.complaints == []
    served.ask("POST", f"/v1/worlds/{world}/end")


def scenes_until(served: Served, world: str, tick: int) -> list[dict[str, object]]:
    """Scenes that a spectator gets, up to a tick."""
    headers = {"authorization": f"Bearer {served.token}"}
    seen = []
    with httpx.stream("GET", f"{served.url}/v1/worlds/{world}/events", headers=headers, timeout=120) as answer:
        assert answer.status_code == 200
        lines = answer.iter_lines()
        for line in lines:
            if line == "event: scene":
                seen.append(json.loads(next(lines).removeprefix("data: ")))
                if seen[-1]["tick"] == tick:
                    return seen
    raise AssertionError(f"the stream ended before tick {tick}")


def test_a_spectator_that_reads_nothing_harms_no_one_and_strangers_see_nothing(served: Served) -> None:
    world = served.ask("POST", "/v1/worlds", {"scenario": street(), "undriven": "stand"})["id"]
    served.ask("POST", f"/v1/worlds/{world}/pause")
    with ExitStack() as deaf:
        for _ in range(5):
            one = deaf.enter_context(socket.socket())
            one.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2048)
            one.connect(("127.0.0.1", int(served.url.rpartition(":")[2])))
            head = f"GET /v1/worlds/{world}/events HTTP/1.1\r\nhost: a\r\nauthorization: Bearer {served.token}\r\n\r\n"
            one.sendall(head.encode())
        served.ask("POST", f"/v1/worlds/{world}/step", {"ticks": 200})
        assert scenes_until(served, world, 200)[-1]["time_s"] == 20.0
        assert [scene["tick"] for scene in scenes_until(served, world, 200)] == [200]  # who comes late sees the present
    made = served.ask("POST", "/v1/tokens", {"owner": "stranger", "role": "organiser"})
    events = f"{served.url}/v1/worlds/{world}/events"
    for headers, status in ({"authorization": f"Bearer {made['token']}"}, 404), ({}, 401):
        assert httpx.get(events, headers=headers, timeout=120).status_code == status
    served.ask("POST", f"/v1/worlds/{world}/end")
    for path in ("events", "replay"):
        answer = httpx.get(
            f"{served.url}/v1/worlds/{world}/{path}", headers={"authorization": f"Bearer {served.token}"}, timeout=120
        )
        assert answer.status_code == 409, answer.text
