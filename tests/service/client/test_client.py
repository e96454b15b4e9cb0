"""One client, blocking and with asyncio; the command line on top of them does all that a submitter needs."""

from __future__ import annotations

import asyncio
import json
import re
from pathlib import Path
from typing import Any

import pytest

from dohyo.evaluation.records.record import AgentInfo
from dohyo.service.accounts.model import Role
from dohyo.service.cli.commands import remote
from dohyo.service.client import generate
from dohyo.service.client.async_client import AsyncClient
from dohyo.service.client.client import Client
from dohyo.service.client.errors import ServiceError
from dohyo.service.evaluations.model import EpisodeStatus, EvaluationStatus
from dohyo.sumo_networks.errors import InvalidInputError
from tests.service.challenges.driving import VERSION, admit, complete, enter, make_challenge
from tests.service.harness import Harness, finish
from tests.service.policies import models
from tests.service.serving import command

INFO = AgentInfo(name="mine", entry="mine:Mine", track="map", sensors=("route",), control="target_speed_steering")


def test_the_blocking_client_and_the_types_are_generated(service: Harness) -> None:
    description = service.client.get("/openapi.json").json()
    command = "run `python -m dohyo.service.client.generate`"
    assert generate.ANSWERS.read_text() == generate.answer_types(description), command
    assert generate.TARGET.read_text() == generate.blocking(generate.SOURCE.read_text()), command
    assert not re.search("async|await", generate.TARGET.read_text().removeprefix(generate.NOTE))


@pytest.fixture
def wired(service: Harness, monkeypatch: pytest.MonkeyPatch) -> Harness:
    """A service in this process that both clients, and so the command line, reach without a network."""
    import httpx

    app = service.client.app

    class Inside(httpx.AsyncClient):
        def __init__(self, **options: Any) -> None:
            super().__init__(transport=httpx.ASGITransport(app), **options)  # type: ignore[arg-type]

    def inside(**options: Any) -> Any:
        service.client.base_url = options["base_url"]
        service.client.headers.pop("authorization", None)
        service.client.headers.update(options["headers"])
        monkeypatch.setattr(service.client, "close", lambda: None)
        return service.client

    monkeypatch.setattr("dohyo.service.client.client.httpx.Client", inside)
    monkeypatch.setattr("dohyo.service.client.client.httpx.AsyncClient", Inside)
    return service


def test_what_one_client_makes_the_other_finds(wired: Harness, tmp_path: Path) -> None:
    token = wired.token("team")
    with Client("http://inside", token) as client:
        assert client.ensure_remote("mine", INFO) == 1
        assert client.ensure_remote("mine", INFO) == 1
        assert client.ensure_remote("mine", INFO.model_copy(update={"sensors": ("speedometer",)})) == 2

    async def tour() -> None:
        async with AsyncClient("http://inside", token) as client:
            assert await client.ensure_remote("mine", INFO) == 1
            assert (await client.ensure_agent("mine"))["version"] == 2
            evaluation = (await client.evaluate("mine", "quickstart", seeds=[0]))["id"]
            manifest = await client.manifest(evaluation)
            assert (manifest["agent"]["name"], manifest["benchmark"]["name"]) == ("mine", "quickstart")
            assert await client.download(evaluation, tmp_path / "records") == []
            with pytest.raises(ServiceError, match="404"):
                await client.record("ep-none")

    asyncio.run(tour())


def cli(wired: Harness, *arguments: str, owner: str = "team") -> Any:
    done = command(*arguments, "--server", "http://inside", "--token", wired.token(owner))
    if done.exception is not None and not isinstance(done.exception, SystemExit):
        raise done.exception
    return done


def test_agents_of_three_kinds_are_submitted_from_the_command_line(wired: Harness, tmp_path: Path) -> None:
    policy = tmp_path / "policy.onnx"
    policy.write_bytes(models.identity().SerializeToString())
    kinds = {
        "pilot": ("--builtin", "reckless"),
        "uploaded": ("--onnx", str(policy), "--sensors", "speedometer"),
        "mine": ("--remote", "--track", "sensors", "--sensors", "speedometer, imu"),
    }
    for agent, options in kinds.items():
        made = json.loads(cli(wired, "submit", agent, *options, "--json").stdout)
        assert (made["agent"], made["version"]) == (agent, 1)
    assert made["sensors"] == ["speedometer", "imu"]
    assert "version 2: builtin, track map" in cli(wired, "submit", "pilot", "--builtin", "reckless").stdout
    with pytest.raises(ServiceError, match="another owner's"):
        cli(wired, "submit", "pilot", "--builtin", "reckless", owner="somebody-else")
    for wrong, says in (((), "expected one of --builtin"), (("--onnx", str(tmp_path / "none")), "no file")):
        with pytest.raises(InvalidInputError, match=says):
            cli(wired, "submit", "new", *wrong)


def test_an_evaluation_is_started_watched_and_ended_from_the_command_line(wired: Harness, tmp_path: Path) -> None:
    cli(wired, "submit", "pilot", "--builtin", "reckless")
    started = json.loads(cli(wired, "evaluations", "start", "pilot", "quickstart", "--seeds", "0-1", "--json").stdout)
    one = started["id"]
    assert (started["seeds"], started["progress"]["total"]) == ([0, 1], 12)
    assert f"{one}: pilot v1 on quickstart, cancelled, 0/12" in cli(wired, "evaluations", "cancel", one).stdout
    assert one in cli(wired, "evaluations", "list", "--agent", "pilot").stdout
    watched = cli(wired, "evaluations", "watch", one)
    assert watched.exit_code == 1
    assert "0 drives" in watched.stdout
    assert "queued" in cli(wired, "evaluations", "resume", one).stdout
    finish(wired.services.database, one, EvaluationStatus.DONE, EpisodeStatus.LOST)
    out = tmp_path / "out"
    assert "0 records" in cli(wired, "evaluations", "fetch", one, "--out", str(out)).stdout
    manifest = json.loads((out / "evaluation.json").read_text())
    assert manifest["benchmark"]["name"] == "quickstart"
    with pytest.raises(InvalidInputError, match="holds results already"):
        cli(wired, "evaluations", "fetch", one, "--out", str(out))
    assert "no complete ranked run yet" in cli(wired, "leaderboard", "quickstart").stderr


def test_the_board_of_a_phase_is_shown_from_its_first_place_to_its_last(
    wired: Harness, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(remote, "PAGE", 2)
    organiser = wired.caller("lab", Role.ORGANISER)
    ranking = make_challenge(organiser, secret=True, draw_seeds=1)
    for number in range(5):
        owner = f"owner-{number}"
        caller = admit(wired, organiser, owner, team=f"team-{number}")
        caller.agent(f"agent-{number}")
        run = enter(caller, f"agent-{number}", ranking)["id"]
        complete(wired.services.database, run, 10.0 * number, dohyo=(VERSION,) if number else ("0.1.0",))
    places = ("leaderboard", "--ranking", ranking)
    whole, first = cli(wired, *places).stdout, cli(wired, *places, "--most", "3").stdout
    assert re.findall(r"team-\d", whole) == [f"team-{number}" for number in (4, 3, 2, 1, 0)]
    assert "places" not in whole
    assert re.findall(r"team-\d", first) == ["team-4", "team-3", "team-2"]
    assert "3 of 5 places" in first
    assert ("another version of dohyo" in whole, "another version of dohyo" in first) == (True, False)
    board = json.loads(cli(wired, *places, "--json").stdout)
    assert ([one["agent"] for one in board["rows"]][-1], board["total"], board["next"]) == ("agent-0", 5, None)
    watched = cli(wired, "evaluations", "watch", run, owner="owner-4")
    assert f"its board: dohyo leaderboard --ranking {ranking}" in watched.stdout
    for wrong in ((), ("quickstart", "--ranking", ranking)):
        with pytest.raises(InvalidInputError, match="expected one of BENCHMARK, --ranking ID"):
            cli(wired, "leaderboard", *wrong)


def test_nobody_there_is_one_line() -> None:
    done = command("evaluations", "list", "--server", "http://127.0.0.1:9")
    assert isinstance(done.exception, ServiceError)
    assert "no answer from http://127.0.0.1:9" in str(done.exception)
