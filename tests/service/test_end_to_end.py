"""As a user: a fresh folder, agents of all three kinds, the leaderboard in a browser, a replay at an infraction."""

from __future__ import annotations

import json
import os
import re
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Browser, Page, expect

from dohyo.evaluation.agent import agent_info
from dohyo.evaluation.benchmarks.benchmark import load_benchmark
from dohyo.evaluation.benchmarks.documents import BENCHMARKS
from dohyo.evaluation.episode.runner import run_episode
from dohyo.evaluation.records.signature import signature_path
from dohyo.evaluation.records.store import read_record
from dohyo.evaluation.running.run import read_result
from dohyo.evaluation.scores.driving import driving_score
from dohyo.service.client.client import Client
from dohyo.service.policies.agent import ENTRY, OnnxPolicy
from dohyo.sumo_networks.errors import InvalidInputError
from examples.onnx_policy import SENSORS, export
from tests.forked import dohyo
from tests.service.browsing import READY, visiting
from tests.service.served import wait_until
from tests.service.serving import Served, command, run, serving

pytestmark = pytest.mark.slow

DRIVES = ("left-to-south", "right-to-east")  # the second one is the shortest; in the first the policy hits somebody
PATIENCE_S = 240.0


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Holds a quickstart of two drives, and the data of a service."""
    made = tmp_path_factory.mktemp("user")
    text = (BENCHMARKS / "quickstart.toml").read_text().replace("seeds = [0, 1, 2]", "seeds = [0]")
    head, *missions = text.split("[[missions]]")
    kept = [mission for mission in missions if any(f'"{name}"' in mission for name in DRIVES)]
    (made / "benchmarks").mkdir()
    (made / "benchmarks" / "quickstart.toml").write_text("[[missions]]".join([head, *kept]))
    return made


@pytest.fixture(scope="module")
def served(folder: Path) -> Iterator[Served]:
    here = f"pathlib.Path({str(folder / 'benchmarks')!r})"
    before = f"import pathlib, dohyo.evaluation.benchmarks.documents as b; b.BENCHMARKS = {here}"
    with serving(folder / "data", before=before) as service:
        yield service
        assert service.end() == 0
        assert not [line for line in service.log if line["level"] in ("error", "text")]


@pytest.fixture(scope="module")
def user(served: Served) -> Iterator[Client]:
    token = served.ask("POST", "/v1/tokens", {"owner": "user", "role": "submitter"})["token"]
    with Client(served.url, token) as client:
        yield client


@pytest.fixture(scope="module")
def evaluations(served: Served, user: Client, folder: Path) -> dict[str, list[dict[str, Any]]]:
    """Episodes by agent, once all three have been evaluated."""
    user.register_agent("pilot", "the built-in autopilot")
    assert user.submit_builtin("pilot", "autopilot")["version"] == 1
    user.register_agent("pursuit", "an uploaded policy")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        export(str(folder / "policy.onnx"))
    spec = {"track": "privileged", "sensors": list(SENSORS), "control": "target_speed_steering"}
    user.submit_onnx("pursuit", folder / "policy.onnx", spec)
    token = served.ask("POST", "/v1/tokens", {"owner": "user", "role": "submitter"})["token"]
    options = ["--server", served.url, "--agent", "remote-pilot", "--entry", "autopilot", "--episodes", "2"]
    worker = dohyo("worker", *options, env=os.environ | {"DOHYO_TOKEN": token})
    try:
        ids = {agent: user.evaluate(agent, "quickstart", ranked=True)["id"] for agent in ("pilot", "pursuit")}
        wait_until(lambda: "remote-pilot" in submitted(user), "the worker submits nothing", PATIENCE_S)
        ids["remote-pilot"] = user.evaluate("remote-pilot", "quickstart", ranked=True)["id"]
        for one in ids.values():
            ended = user.wait(one, PATIENCE_S)
            assert (ended["status"], ended["progress"]["done"]) == ("done", len(DRIVES)), ended
        assert worker.wait() == 0
    finally:
        worker.kill()
        worker.wait()
    return {agent: list(user.episodes(one)) for agent, one in ids.items()}


def submitted(user: Client) -> set[str]:
    return {one["name"] for one in user.items("/v1/agents") if one["version"]}


def hashes(episodes: list[dict[str, Any]]) -> list[str]:
    return [one["record_hash"] for one in episodes]


def test_local_and_builtin_give_the_same_hashes_and_remote_the_same_drives(
    evaluations: dict[str, list[dict[str, Any]]], user: Client, folder: Path
) -> None:
    benchmark, out = folder / "benchmarks" / "quickstart.toml", folder / "out"
    options = ["--benchmark", str(benchmark), "--seeds", "0", "--workers", "1"]
    done = run("evaluate", "--agent", "autopilot", *options, "--out", str(out), patience_s=PATIENCE_S)
    assert done.returncode == 0, done.stderr
    local = {json.loads(path.read_text())["record_hash"] for path in (out / "records").glob("*.json")}
    assert set(hashes(evaluations["pilot"])) == local
    assert len(local) == len(DRIVES)
    pilot, remote = ([user.record(one["id"]) for one in evaluations[agent]] for agent in ("pilot", "remote-pilot"))
    assert [one["trajectory_sha256"] for one in pilot] == [one["trajectory_sha256"] for one in remote]
    assert [one["egos"][0]["agent"]["kind"] for one in (*pilot, *remote)] == ["builtin"] * 2 + ["remote"] * 2


def test_an_uploaded_policy_gives_the_hashes_of_its_file_here(
    evaluations: dict[str, list[dict[str, Any]]], folder: Path
) -> None:
    benchmark = load_benchmark(str(folder / "benchmarks" / "quickstart.toml"))
    policy = OnnxPolicy(path=folder / "policy.onnx", name="pursuit", track="privileged", sensors=SENSORS)
    try:
        record = run_episode(
            benchmark.scenarios([0])[1],
            {"ego": policy},
            infos={"ego": agent_info(policy, ENTRY, policy.settings, "onnx")},
            benchmark=(benchmark.name, benchmark.sha256),
        )
    finally:
        policy.close()
    assert record.record_hash == hashes(evaluations["pursuit"])[1]


def test_the_leaderboard_says_what_the_records_say(
    evaluations: dict[str, list[dict[str, Any]]], user: Client, folder: Path
) -> None:
    board = user.leaderboard("quickstart")
    assert [row["agent"] for row in board["rows"]][-1] == "pursuit"
    for row in board["rows"]:
        paths = user.download(row["evaluation"], folder / "records" / row["agent"])
        scores = [driving_score(read_record(path).egos[0], "2.0") for path in paths]
        assert row["scores"]["driving_score"]["mean"] == pytest.approx(sum(scores) / len(DRIVES))
        assert (row["seeds"], row["drives"]) == (1, len(DRIVES))


def test_what_is_fetched_is_a_result_folder_to_report(
    evaluations: dict[str, list[dict[str, Any]]], served: Served, user: Client, folder: Path
) -> None:
    out = folder / "fetched"
    options = ("--server", served.url, "--token", served.token, "--out", str(out))
    done = run("evaluations", "fetch", evaluations["pilot"][0]["evaluation"], *options)
    assert done.returncode == 0, done.stderr
    result = read_result(out)
    assert [record.record_hash for record in result.records] == hashes(evaluations["pilot"])
    assert result.manifest.agent == result.records[0].egos[0].agent


def test_a_fetched_record_is_verified_by_signature_and_by_driving_again(
    evaluations: dict[str, list[dict[str, Any]]],
    served: Served,
    user: Client,
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("DOHYO_HOME", str(folder / "home"))
    paths = {
        agent: user.download(episodes[0]["evaluation"], folder / "signed" / agent)[1]
        for agent, episodes in evaluations.items()
    }
    builtin = run("verify", str(paths["pilot"]), "--server", served.url)
    assert (builtin.returncode, f"key of {served.url}" in builtin.stdout, "same:" in builtin.stdout) == (0, True, True)
    policy = command("verify", str(paths["pursuit"]), "--policy", str(folder / "policy.onnx"), "--json")
    assert policy.exit_code == 0, policy.exception
    assert json.loads(policy.stdout)["same"] is True
    assert json.loads(policy.stdout)["signature"]["owner"] == f"key of {served.url}", "kept since the first time"
    remote = command("verify", str(paths["remote-pilot"]), "--signature-only")
    assert (remote.exit_code, "hash right, not driven again" in remote.stdout) == (0, True)
    assert "drove through policy workers" in str(command("verify", str(paths["remote-pilot"])).exception)
    other = signature_path(paths["pursuit"]).read_bytes()
    signature_path(paths["pilot"]).write_bytes(other)
    refused = command("verify", str(paths["pilot"]))
    assert isinstance(refused.exception, InvalidInputError)
    assert "of another record" in str(refused.exception)


def test_the_leaderboard_leads_to_the_replay_of_an_infraction(
    evaluations: dict[str, list[dict[str, Any]]], served: Served, user: Client, browser: Browser
) -> None:
    with visiting(browser, served.url) as visit:
        window = visit()
        page: Page = window.go("/")
        for agent in evaluations:
            expect(page.get_by_role("link", name=agent, exact=True)).to_be_visible()
        page.get_by_role("link", name="pursuit", exact=True).click()
        page.wait_for_url(re.compile("/agents/pursuit"))
        page.wait_for_selector(READY)
        page.goto(f"{served.url}/evaluations/{evaluations['pursuit'][0]['evaluation']}")
        page.wait_for_selector(READY)
        hit = page.locator("a[href*='#t=']").first
        (first, *_) = user.get(f"/v1/episodes/{evaluations['pursuit'][0]['id']}/events")["egos"][0]["infractions"]
        assert first["kind"] == "collision_pedestrian"
        page.goto(served.url + str(hit.get_attribute("href")))
        page.wait_for_selector(READY)
        minutes, seconds = divmod(first["time_s"], 60)
        expect(page.locator(".clock")).to_contain_text(f"{minutes:.0f}:{seconds:04.1f} /")
        expect(page.locator(".infractions")).to_contain_text("pedestrian hit")
        assert window.complaints == []
        assert window.foreign == []
