"""Days of forecasts at a service: all kinds of submission get the numbers of the local command; bad answers fail."""

from __future__ import annotations

import json
import runpy
import shutil
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sqlalchemy import select

from dohyo.agents.forecasting import benchmark as local
from dohyo.agents.forecasting.registry import CHECKPOINTS
from dohyo.agents.registry import describe_agent, resolve
from dohyo.evaluation.freeway.benchmark import ForecastBenchmark, days_folder, load_forecasting
from dohyo.evaluation.freeway.day import DayRecord, DayScenario
from dohyo.evaluation.records.record import AgentInfo
from dohyo.service.client.client import Client
from dohyo.service.client.connection import BadActionError, LeaseLostError
from dohyo.service.client.errors import ServiceError
from dohyo.service.client.worker import Driver, work
from dohyo.service.client.worker_session import Drive, WorkerSession
from dohyo.service.database.engine import Database
from dohyo.service.evaluations.model import Episode, EpisodeStatus, Evaluation, EvaluationStatus
from dohyo.service.evaluations.scoring import FORECAST_SCORES, summary_of_day
from dohyo.service.forecasting.drive import judge_again
from dohyo.service.submissions.model import AgentKind
from tests.agents.forecasting.roads import write_folder
from tests.service.harness import Harness, assert_problem, finish, running
from tests.service.served import Service
from tests.service.serving import command

HARD = "forecast-hard"
REMOTE = {"kind": "remote", "track": "sensors", "sensors": ["history"], "control": "speeds_ahead"}
SHIPPED = resolve("forecaster")
TSMIXER = {"model": "tsmixer", "exported": True}
FORECASTS = 20
"""Of each hand-made day."""


@pytest.fixture(scope="module")
def hard(tmp_path_factory: pytest.TempPathFactory, running_service: Service) -> Iterator[ForecastBenchmark]:
    """The benchmark, with four short hand-made days where the service keeps its own."""
    folder = tmp_path_factory.mktemp("days")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("DOHYO_HOME", str(running_service.data.resolve()))
        patch.setattr(local, "TIMED", 2)
        patch.setattr(local, "WARM_UPS", 1)
        benchmark = load_forecasting(HARD)
        days = write_folder(folder / "made", rows=FORECASTS + 10, missing=0.05) / "hard"
        for number in (1, 2):
            shutil.copy(days / f"day-000{number}.parquet", days / f"day-000{number + 2}.parquet")
        shutil.copytree(days, days_folder(benchmark) / "hard")
        yield benchmark


@pytest.fixture(scope="module")
def service(hard: ForecastBenchmark, running_service: Service) -> Service:
    return running_service


@pytest.fixture(scope="module")
def client(service: Service) -> Iterator[Client]:
    with Client(service.url, service.submitter_token) as one:
        yield one


def test_every_kind_of_submission_gets_the_numbers_of_the_local_command(
    client: Client, service: Service, hard: ForecastBenchmark, tmp_path: Path
) -> None:
    """The same forecaster as built-in agent, as ONNX file and through a worker over HTTP.

    The file computes in single precision, so that its forecasts differ in the last digits.
    """
    client.ensure_agent("built-in", "")
    client.submit_builtin("built-in", "forecaster", TSMIXER)
    client.ensure_agent("uploaded", "")
    client.submit_onnx("uploaded", CHECKPOINTS / "tsmixer.onnx", {key: REMOTE[key] for key in REMOTE if key != "kind"})
    client.ensure_remote("remote", describe_agent(SHIPPED, TSMIXER, "remote"))
    ordered = {name: client.evaluate(name, HARD)["id"] for name in ("built-in", "uploaded", "remote")}
    work(WorkerSession(service.url, service.token, "remote"), Driver(SHIPPED, TSMIXER), episodes=4)
    records = {name: recorded(client, service, one) for name, one in ordered.items()}
    here = local.evaluate_forecaster(hard, "forecaster", TSMIXER, tmp_path / "local")
    for name, days in records.items():
        for day, own in zip(days, here.units.values(), strict=True):
            assert day.measures == (pytest.approx(own, rel=1e-4) if name == "uploaded" else own), name
        assert [day.forecasts for day in days] == [FORECASTS] * 4
        assert all(day.agent.kind == kind_of(name) for day in days)
    digests = {name: [day.forecasts_sha256 for day in days] for name, days in records.items()}
    assert digests["built-in"] == digests["remote"]
    scores = client.metrics(ordered["remote"])["all"]["scores"]
    assert scores.keys() == set(FORECAST_SCORES)
    for key, estimate in here.estimates.items():
        assert scores[key]["mean"] == pytest.approx(estimate.mean)
        assert scores[key]["low"] == pytest.approx(estimate.low)
    fetched_days_are_verified(ordered, service, tmp_path)


def test_the_example_forecasts_a_day(service: Service, client: Client, monkeypatch: pytest.MonkeyPatch) -> None:
    benchmark = load_forecasting(HARD).model_copy(update={"number": 1})
    evaluation = service.submit(remote_info("example"), benchmark, seeds=[benchmark.seed])
    monkeypatch.setattr(sys, "argv", ["forecaster.py", service.url, service.token, "example", "1"])
    runpy.run_path("examples/forecaster.py", run_name="__main__")
    (day,) = recorded(client, service, evaluation)
    assert day.failure is None
    assert day.forecasts == FORECASTS


@pytest.mark.slow
def test_a_whole_day_that_nobody_has_made_is_made_by_the_service(service: Service, client: Client) -> None:
    """Its queues are simulated from an episode process, which may open no socket; here the day is made once more."""
    benchmark = load_forecasting("forecast-easy").model_copy(update={"number": 1})
    info = describe_agent(SHIPPED, TSMIXER, "builtin")
    evaluation = service.submit(info, benchmark, seeds=[5], kind=AgentKind.BUILTIN)
    (day,) = recorded(client, service, evaluation)
    assert day.failure is None
    assert judge_again(day).content_hash() == day.content_hash()


def kind_of(name: str) -> str:
    return {"built-in": "builtin", "uploaded": "onnx"}.get(name, "remote")


def recorded(client: Client, service: Service, evaluation: str) -> list[DayRecord]:
    """Records of a run that must be done."""
    hashes = service.hashes(evaluation)
    days = [DayRecord.model_validate(client.record(one.id)) for one in service.episodes(evaluation)]
    assert [day.content_hash() for day in days] == hashes
    return days


def fetched_days_are_verified(ordered: dict[str, str], service: Service, folder: Path) -> None:
    access = ("--server", service.url, "--token", service.submitter_token)
    for name in ("built-in", "remote"):
        done = command("evaluations", "fetch", ordered[name], "--out", str(folder / name), *access)
        assert f"4 records in {folder / name}" in done.stdout, done.stderr
    path = folder / "built-in" / "records" / "day-0002-s1.json"
    assert json.loads(command("verify", str(path), "--json").stdout)["same"]
    of_worker = folder / "remote" / "records" / "day-0002-s1.json"
    assert "policy workers" in str(command("verify", str(of_worker)).exception)
    assert "hash right" in command("verify", str(of_worker), "--signature-only").stdout
    episode = service.episodes(ordered["built-in"])[0].id
    with Client(service.url, service.submitter_token) as client:
        for part in ("trajectory", "replay", "events"):
            with pytest.raises(ServiceError, match=r"day of forecasts|no drives on roads") as refused:
                client.get(f"/v1/episodes/{episode}/{part}")
            assert refused.value.status == 409


def test_bad_forecasts_are_refused_and_a_late_one_fails_the_agent(client: Client, service: Service) -> None:
    """The server goes on with the next worker."""
    benchmark = load_forecasting(HARD).model_copy(update={"number": 1})
    evaluation = service.submit(remote_info("hasty"), benchmark, seeds=[benchmark.seed], act_deadline_s=5.0)
    with WorkerSession(service.url, service.token, "hasty") as session:
        drive = acquired(session)
        history = drive.observations["forecaster"]["history"]
        assert history.shape == (8, 21)
        assert np.isfinite(history).all()
        last = np.repeat(history[-1:], 3, axis=0)
        for bad, said in ((last[:2], "3 lists of 21 numbers"), (np.full_like(last, np.nan), "finite")):
            with pytest.raises(BadActionError, match=said):
                session.step(drive, {"forecaster": bad})
        session.step(drive, {"forecaster": last})
        shown = drive.observations["forecaster"]["history"]
        assert np.mean(shown[:-1] == history[1:]) > 0.9  # one minute later; gaps at the beginning are filled anew
        time.sleep(8.0)  # some of it may be a standstill of the service, which is not charged
        with pytest.raises(LeaseLostError):
            session.step(drive, {"forecaster": last})
    (day,) = recorded(client, service, evaluation)
    assert (day.measures, day.forecasts) == ({}, 1)
    assert "5 s" in str(day.failure)
    (episode,) = service.episodes(evaluation)
    assert episode.summary is not None
    assert episode.summary["egos"][0]["status"] == "failed: agent did not answer in time"


def remote_info(name: str) -> AgentInfo:
    facts = {key: REMOTE[key] for key in ("track", "sensors", "control")}
    return AgentInfo.model_validate({"name": name, "kind": "remote", "entry": f"remote:{name}"} | facts)


def acquired(session: WorkerSession) -> Drive:
    drive = None
    while drive is None:
        drive = session.acquire()
    return drive


@pytest.fixture(scope="module")
def drives_nothing(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Harness]:
    with running(tmp_path_factory.mktemp("idle") / "data") as harness:
        yield harness


def test_forecasters_forecast_and_drivers_drive(drives_nothing: Harness) -> None:
    team = drives_nothing.caller("team")
    for name in ("mine", "driver"):
        team.post("/v1/agents", {"name": name})
    for wrong in ({"track": "map"}, {"sensors": ["speedometer"]}, {"sensors": ["time_of_day"]}):
        assert_problem(team.post("/v1/agents/mine/submissions", REMOTE | wrong), 422, "that of a forecaster")
    assert team.post("/v1/agents/mine/submissions", REMOTE).status_code == 201
    assert team.post("/v1/agents/driver/submissions", {"kind": "remote"}).status_code == 201
    for agent, benchmark in (("mine", "dissipation"), ("mine", "quickstart"), ("driver", HARD)):
        refused = team.post("/v1/evaluations", {"agent": agent, "benchmark": benchmark})
        assert_problem(refused, 422, f"benchmark '{benchmark}': expected", f"'{agent}' has control")
    ordered = team.post("/v1/evaluations", {"agent": "mine", "benchmark": HARD, "ranked": True}).json()
    assert ordered["progress"]["total"] == 4
    manifest = team.get(f"/v1/evaluations/{ordered['id']}/manifest").json()
    assert (manifest["agent"]["name"], manifest["benchmark"]["name"]) == ("mine", HARD)
    listed = {one["name"]: one for one in team.get("/v1/benchmarks").json()}
    assert (listed["forecast-easy"]["kind"], listed["forecast-easy"]["scenarios"]) == ("forecasting", 12)
    described = team.get(
        "/v1/observations", params={"track": "sensors", "sensors": "history", "control": "speeds_ahead"}
    )
    assert (described.json()["inputs"][0]["shape"], described.json()["outputs"][0]["shape"]) == ([8, 21], [3, 21])


def test_the_smallest_error_is_first_on_the_board(drives_nothing: Harness) -> None:
    """And a run with a day that its forecaster failed has no place."""
    team = drives_nothing.caller("board")
    for name, error in (("wrong", 9.0), ("right", 5.0), ("failed", None)):
        team.post("/v1/agents", {"name": name})
        team.post(f"/v1/agents/{name}/submissions", REMOTE)
        order = {"agent": name, "benchmark": "forecast-easy", "ranked": True}
        judge(drives_nothing.services.database, team.post("/v1/evaluations", order).json()["id"], error)
    board = team.get("/v1/leaderboard", params={"benchmark": "forecast-easy"}).json()
    assert [(row["agent"], row["rank"]) for row in board["rows"]] == [("right", 1), ("wrong", 2)]
    assert board["rows"][0]["scores"].keys() == set(FORECAST_SCORES)
    assert board["rows"][0]["scores"]["rmse_1"]["mean"] == pytest.approx(np.sqrt(5.65))
    text = team.get("/v1/leaderboard.csv", params={"benchmark": "forecast-easy"}).text
    assert "mse_3_low" in text.splitlines()[0]


def judge(database: Database, evaluation_id: str, error: float | None) -> None:
    """Ends a run as if it had been judged, with an error that grows with the day; None: it failed."""
    with database.session() as session:
        for episode in session.scalars(select(Episode).where(Episode.evaluation_id == evaluation_id)):
            scenario = DayScenario(benchmark=load_forecasting("forecast-easy"), seed=1, number=episode.position + 1)
            measures = dict.fromkeys(FORECAST_SCORES, (error or 0.0) + 0.1 * scenario.number)
            facts: dict[str, Any] = {"failure": "it broke"} if error is None else {"measures": measures}
            record = DayRecord(scenario=scenario, benchmark=("forecast-easy", "0"), agent=remote_info("p"), **facts)
            episode.summary, episode.record_hash = summary_of_day(record), record.content_hash()
        session.get_one(Evaluation, evaluation_id).dohyo_versions = ["0.2.0"]
    finish(database, evaluation_id, EvaluationStatus.DONE, EpisodeStatus.DONE)
