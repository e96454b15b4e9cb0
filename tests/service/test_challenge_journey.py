"""As an organiser and two participants, in a real browser: a challenge from its making to its final board."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime, timedelta
from functools import partial
from pathlib import Path

import httpx
import numpy as np
import onnx
import pytest
from onnx import helper
from playwright.sync_api import Browser, Locator, Page, expect

from tests.forked import Python, dohyo
from tests.service.browsing import READY, visiting
from tests.service.harness import patiently
from tests.service.policies.models import model
from tests.service.served import wait_until
from tests.service.serving import Served, serving

pytestmark = pytest.mark.slow

SPRINT = """
name = "sprint"
description = "Thirty metres along one empty street"
headline = "driving_score"
metric = "driving score: route completion times infraction penalty"
rules = "2.0"
network = "ingolstadt"
seeds = [0]

[traffic]
warm_up_s = 0.0

[[missions]]
name = "straight-on"
start = { lane = "737320747#3_2", position_m = 5.0 }
goal = { lane = "737320747#4_2", position_m = 30.0 }
"""
# A clock that a test puts an hour ahead: it makes the file. Modules that were loaded before keep their `base.now`.
CLOCK = """
import pathlib, dohyo.service.database.base as base, dohyo.evaluation.benchmarks.documents as documents
from datetime import datetime, timedelta
folder = pathlib.Path({folder!r})

class Clock(datetime):
    @classmethod
    def now(cls, zone):
        return datetime.now(zone) + timedelta(hours=(folder / "an-hour-later").exists())

base.datetime = Clock
documents.BENCHMARKS = folder / "benchmarks"
"""
PATIENCE_S = 240.0
RULES = "# One road\n\n- **Nobody** is hit.\n- <img src=x onerror=alert(1)> is text."


@dataclass
class Entrant:
    """A participant with a browser of its own."""

    name: str
    page: Page
    token: str = ""

    def http(self, served: Served) -> httpx.Client:
        headers = {"authorization": f"Bearer {self.token}"}
        return httpx.Client(base_url=served.url, headers=headers, timeout=120, trust_env=False)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Holds the benchmarks of the service, and its data."""
    made = tmp_path_factory.mktemp("challenge")
    (made / "benchmarks").mkdir()
    (made / "benchmarks" / "sprint.toml").write_text(SPRINT)
    return made


@pytest.fixture(scope="module")
def served(folder: Path) -> Iterator[Served]:
    with serving(folder / "data", before=CLOCK.format(folder=str(folder))) as service:
        yield service
        assert service.end() == 0


@pytest.fixture(scope="module")
def policy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An ONNX policy that drives straight on at 6 m/s, whatever it sees."""
    nodes = [helper.make_node("Mul", ["speedometer", "zero"], ["nothing"])]
    nodes.append(helper.make_node("Add", ["nothing", "target"], ["action"]))
    constants = {"zero": np.zeros(2, np.float32), "target": np.array([6.0, 0.0], np.float32)}
    path = tmp_path_factory.mktemp("policy") / "straight.onnx"
    onnx.save(model(nodes, constants=constants), path)
    return path


def sign_in(page: Page, served: Served, token: str, to: str) -> None:
    page.goto(f"{served.url}/login?next={to}")
    page.get_by_label("Token").fill(token)
    page.get_by_role("button", name="sign in").click()
    page.wait_for_selector(READY)


def opened(page: Page, served: Served, path: str) -> Page:
    page.goto(served.url + path)
    page.wait_for_selector(READY)
    return page


def make_challenge(page: Page, closes: datetime) -> None:
    """Makes the challenge "autumn" with one secret phase."""
    page.get_by_label("Name").fill("autumn")
    page.get_by_label("Title").fill("Autumn challenge")
    page.get_by_label("Rules").fill(RULES)
    page.get_by_role("button", name="make the challenge").click()
    page.wait_for_url("**/challenges/autumn/organise")
    page.get_by_label("Name").fill("final")
    page.get_by_label("Benchmark").select_option("sprint")
    page.get_by_label("Seeds").fill("6")
    page.get_by_label("Secret").select_option("yes")
    page.get_by_label("Ranked runs of a team").fill("1")
    page.get_by_label("Closes").fill(closes.strftime("%Y-%m-%dT%H:%M:%S"))
    page.get_by_label("Grace, minutes").fill("0")
    page.get_by_role("button", name="add the phase").click()
    expect(page.locator("#phases tbody th")).to_have_text("final")


def postpone(page: Page, closes: datetime) -> None:
    """Moves the end of the phase: refused to an earlier time, done to a later one."""
    page.get_by_text("postpone the end of a phase").click()
    page.get_by_label("New end").fill((closes - timedelta(minutes=20)).strftime("%Y-%m-%dT%H:%M:%S"))
    page.get_by_role("button", name="postpone").click()
    expect(page.locator("#phases .problem[role=alert]").first).to_contain_text("can only be postponed")
    page.get_by_label("New end").fill(closes.strftime("%Y-%m-%dT%H:%M:%S"))
    page.get_by_role("button", name="postpone").click()
    expect(page.get_by_label("New end")).to_be_hidden()  # the page is new
    page.wait_for_selector(READY)


def mark_a_baseline(page: Page, served: Served, token: str) -> None:
    for path, body in (("", {"name": "house"}), ("/house/submissions", {"kind": "remote"})):
        headers = {"authorization": f"Bearer {token}"}
        httpx.post(
            f"{served.url}/v1/agents{path}", json=body, headers=headers, timeout=120, trust_env=False
        ).raise_for_status()
    opened(page, served, "/challenges/autumn/organise")
    page.locator("#baselines").get_by_label("Agent").select_option("house")
    page.get_by_role("button", name="mark as baseline").click()
    expect(page.locator("#baselines tbody")).to_contain_text("house v1")


def invite(page: Page, who: str) -> str:
    page.get_by_label("For", exact=True).fill(who)
    page.get_by_role("button", name="make an invitation").click()
    expect(page.locator(".once h3")).to_have_text(f"Invitation for {who}")
    return page.locator(".once .secret").inner_text()


def enter(page: Page, served: Served, code: str, name: str) -> Entrant:
    """Redeems an invitation without any script: the form is plain HTML."""
    opened(page, served, "/join")
    page.get_by_label("Invitation code").fill(code)
    page.get_by_label("Your name here").fill(name)
    page.get_by_role("button", name="take part").click()
    return Entrant(name, page, page.locator(".secret").inner_text())


def start_ranked(page: Page, agent: str) -> None:
    page.get_by_label("Agent", exact=True).select_option(agent)
    page.get_by_label("Run", exact=True).select_option(label="ranked, phase final")
    page.get_by_role("button", name="start the run").click()


def test_a_challenge_from_its_making_to_its_final_board(
    served: Served, browser: Browser, policy: Path, folder: Path, tmp_path: Path
) -> None:
    organiser_token = served.ask("POST", "/v1/tokens", {"owner": "organiser", "role": "organiser"})["token"]
    with visiting(browser, served.url) as visit:
        organiser, ann_window, bob_window = visit(), visit(), visit()
        page = organiser.page
        sign_in(page, served, organiser_token, "/challenges")
        closes = datetime.now() + timedelta(minutes=50)  # the browser's local time zone is that of this process
        make_challenge(page, closes - timedelta(minutes=10))
        postpone(page, closes)
        mark_a_baseline(page, served, organiser_token)
        codes = [invite(page, who) for who in ("ann", "bob")]

        ann, bob = enter(ann_window.page, served, codes[0], "ann"), enter(bob_window.page, served, codes[1], "bob")
        expect(enter_again(bob.page, served, codes[0])).to_contain_text("no open invitation")

        upload_in_the_browser(ann, served, policy)
        start_ranked(ann.page, "ann-onnx")
        expect(ann.page.locator("#runs tbody")).to_contain_text("ranked, final")
        expect(ann.page.locator("#team .tiles")).to_contain_text("0 of 1")

        refuse_own_seeds(bob, served)
        worker = drive_from_another_process(bob, served, tmp_path)
        try:
            release_until_lucky(bob, served)
            forge_a_record(bob, served)
            await_done(ann, bob, served)
        finally:
            worker.kill()
            worker.wait()

        (folder / "an-hour-later").touch()
        for window in (organiser.page, ann.page, bob.page):
            expect_final_board(window, served)
        said = [text for one in (organiser, ann_window, bob_window) for text in one.complaints]
        assert [text for text in said if "Failed to load resource" not in text] == []  # refusals, which are shown
        assert [one.foreign for one in (organiser, ann_window, bob_window)] == [[], [], []]


def enter_again(page: Page, served: Served, code: str) -> Locator:
    """What is said to somebody who redeems a used code."""
    opened(page, served, "/join")
    page.get_by_label("Invitation code").fill(code)
    page.get_by_role("button", name="take part").click()
    return page.locator(".problem")


def upload_in_the_browser(ann: Entrant, served: Served, policy: Path) -> None:
    """Uploads a broken file, is told so beside the field, and then uploads the policy."""
    page = opened(ann.page, served, "/submit?challenge=autumn")
    page.get_by_label("Name").fill("ann-onnx")
    page.get_by_label("File").set_input_files({"name": "a.onnx", "mimeType": "", "buffer": b"no model at all"})
    page.get_by_label("Sensors").fill("speedometer")
    page.get_by_role("button", name="submit").click()
    expect(page.locator("[data-field=file] .problem")).to_be_visible(timeout=PATIENCE_S * 1000)
    page.get_by_label("File").set_input_files(policy)
    page.get_by_role("button", name="submit").click()
    expect(page.locator(".submitted")).to_contain_text("ann-onnx v1 is submitted", timeout=PATIENCE_S * 1000)
    page.get_by_role("link", name="start a run").click()
    page.wait_for_selector(READY)
    assert page.locator("img").count() == 0
    expect(page.locator(".prose")).to_contain_text("<img src=x onerror=alert(1)> is text.")


def drive_from_another_process(bob: Entrant, served: Served, folder: Path) -> Python:
    """Bob makes a worker's token in the browser, submits a remote agent, and starts a worker and a ranked run."""
    page = opened(bob.page, served, "/account")
    page.get_by_role("button", name="make a token").click()
    token = page.locator(".once .secret").inner_text()
    opened(page, served, "/submit?challenge=autumn")
    environment = os.environ | {"DOHYO_TOKEN": bob.token}
    options = ["--server", served.url, "--agent", "bob-remote", "--entry", "idm"]
    worker = dohyo("worker", *options, env=environment, cwd=folder)
    with bob.http(served) as http:

        def submitted() -> bool:
            assert worker.poll() is None
            return any(one["name"] == "bob-remote" and one["version"] for one in http.get("/v1/agents").json()["items"])

        wait_until(submitted, "the worker submits nothing")
        mine = {"authorization": f"Bearer {token}"}
        assert httpx.get(f"{served.url}/v1/me", headers=mine, timeout=120).json()["role"] == "worker"
    opened(page, served, "/challenges/autumn")
    start_ranked(page, "bob-remote")
    expect(page.locator("#runs tbody")).to_contain_text("bob-remote")
    return worker


def refuse_own_seeds(bob: Entrant, served: Served) -> None:
    """First forgery: seeds of one's own choice in a ranked run; also, reading the secret ones."""
    with bob.http(served) as http:
        http.post("/v1/agents", json={"name": "bob-builtin"})
        order = {"kind": "builtin", "entry": "idm"}
        path = "/v1/agents/bob-builtin/submissions"
        made = patiently(lambda prefer: http.post(path, json=order, headers=prefer))
        assert made.status_code == 201, made.text
        phase = http.get("/v1/challenges/autumn").json()["phases"][0]
        assert phase["seeds"] is None
        ranked = {"agent": "bob-builtin", "benchmark": "sprint", "ranked": True, "ranking": phase["id"]}
        answer = http.post("/v1/evaluations", json={**ranked, "seeds": [777]})
        assert answer.status_code == 422
        assert answer.json()["errors"][0]["where"] == "body.seeds"


def release_until_lucky(bob: Entrant, served: Served) -> None:
    """Second forgery: cancel a ranked run and order another one, until the result is lucky."""
    with bob.http(served) as http:
        phase = http.get("/v1/challenges/autumn").json()["phases"][0]
        ranked = {"agent": "bob-remote", "benchmark": "sprint", "ranked": True, "ranking": phase["id"]}
        answer = http.post("/v1/evaluations", json=ranked)
        assert answer.status_code == 429
        assert "all count, also cancelled ones" in answer.json()["detail"]
    page = opened(bob.page, served, "/challenges/autumn")
    start_ranked(page, "bob-remote")
    expect(page.locator("#team .fields [role=alert]")).to_contain_text("all count, also cancelled ones")


def forge_a_record(bob: Entrant, served: Served) -> None:
    """Third forgery: a record of one's own making. The service takes none, and signs its own."""
    with bob.http(served) as http:
        episodes = http.get("/openapi.json").json()["paths"]
        takes = [
            path for path, methods in episodes.items() if re.search("record", path) and {"post", "put"} & set(methods)
        ]
        assert takes == []
        run = next(one for one in http.get("/v1/evaluations").json()["items"] if one["agent"] == "bob-remote")
        for path in (f"/v1/evaluations/{run['id']}/episodes", f"/v1/evaluations/{run['id']}"):
            assert http.put(path, json={}).status_code == 405
            assert http.patch(path, json={}).status_code == 405


def await_done(ann: Entrant, bob: Entrant, served: Served) -> None:
    def done(http: httpx.Client, owner: str) -> bool:
        runs = http.get("/v1/evaluations").json()["items"]
        return any(one["ranking"] and one["owner"] == owner and one["status"] == "done" for one in runs)

    for entrant in (ann, bob):
        with entrant.http(served) as http:
            wait_until(partial(done, http, entrant.name), f"the run of {entrant.name} does not end")


def expect_final_board(page: Page, served: Served) -> None:
    opened(page, served, "/challenges/autumn")
    expect(page.locator("#board h3")).to_have_text("Final board")
    board = page.locator("#board tbody")
    expect(board).to_contain_text("ann-onnx")
    expect(board).to_contain_text("bob-remote")
    expect(board.locator(".verified").filter(has_text="remote")).to_have_count(1)
