"""Mornings on the freeway as evaluations: a planner in a process of its own, and orders that are refused."""

from __future__ import annotations

import hashlib
import json
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from onnx import helper
from sqlalchemy import select

from dohyo.evaluation.freeway.benchmark import TrafficBenchmark, load_freeway_benchmark
from dohyo.evaluation.freeway.morning import MorningRecord, MorningScenario
from dohyo.evaluation.records.record import AgentInfo
from dohyo.service.client.client import Client
from dohyo.service.client.connection import BadActionError
from dohyo.service.client.errors import ServiceError
from dohyo.service.client.worker_session import WorkerSession
from dohyo.service.database.engine import Database
from dohyo.service.evaluations.model import Episode, EpisodeStatus, Evaluation, EvaluationStatus
from dohyo.service.evaluations.scoring import MORNING_SCORES, is_agent_fault, summary_of_morning
from dohyo.service.freeway.drive import FASTEST_MPS, checked, drive_morning, vehicles
from dohyo.service.freeway.planner import plan_shape
from dohyo.service.running.gauge import GAUGE_BYTES, Gauge
from dohyo.service.running.order import EpisodeOrder
from dohyo.service.submissions.model import AgentKind
from dohyo.sumo_networks.errors import InvalidInputError
from tests.service.harness import Harness, assert_problem, finish, running
from tests.service.policies.models import model
from tests.service.served import ROOT, Service
from tests.service.serving import command

PLANNER = {"kind": "remote", "track": "privileged", "sensors": ["speeds"], "control": "target_speeds"}
NIGHT_S = 7200.0
"""Hardly anybody drives, so that a morning is simulated in seconds."""


def benchmark(minutes: int) -> TrafficBenchmark:
    found = load_freeway_benchmark("dissipation")
    assert isinstance(found, TrafficBenchmark)
    return found.model_copy(update={"name": f"night-{minutes}", "duration_s": 60.0 * minutes, "start_s": NIGHT_S})


def planner(name: str) -> AgentInfo:
    facts = {"track": "privileged", "sensors": ("speeds",), "control": "target_speeds"}
    return AgentInfo(name=name, kind="remote", entry=f"remote:{name}", **facts)  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def service(running_service: Service) -> Service:
    return running_service


@pytest.fixture(scope="module")
def client(service: Service) -> Any:
    with Client(service.url, service.submitter_token) as one:
        yield one


@pytest.mark.slow
def test_a_planner_in_a_process_of_its_own_has_records_and_scores(
    client: Client, service: Service, tmp_path: Path
) -> None:
    evaluation = service.submit(planner("even"), benchmark(2), seeds=(3, 4))
    program = [sys.executable, "examples/planner.py", service.url, service.token, "even", "2"]
    worker = subprocess.run(program, cwd=ROOT, env={"PYTHONPATH": str(ROOT)}, timeout=300, capture_output=True)
    assert worker.returncode == 0, worker.stderr.decode()
    told = [f"{(NIGHT_S + 60 * minute) / 3600:.2f} h" for minute in (1, 2)]
    assert worker.stdout.decode().splitlines() == told * 2
    assert service.wait(evaluation).status is EvaluationStatus.DONE
    for episode in service.episodes(evaluation):
        record = MorningRecord.model_validate(client.record(episode.id))
        assert record.content_hash() == record.record_hash == episode.record_hash
        assert (record.scenario.seed, record.plans, record.failure) == (episode.seed, 2, None)
        for part in ("trajectory", "replay", "events"):
            with pytest.raises(ServiceError) as refused:
                client.get(f"/v1/episodes/{episode.id}/{part}")
            assert refused.value.status == 409
    summary = client.get(f"/v1/evaluations/{evaluation}/metrics")["all"]
    assert summary["scores"]["speed_mps"]["mean"] > 10.0
    assert summary["scores"].keys() >= {"speed_std_mps", "throughput_vph"}
    fetched_mornings_are_verified(evaluation, service, tmp_path)


def fetched_mornings_are_verified(evaluation: str, service: Service, folder: Path) -> None:
    access = ("--server", service.url, "--token", service.submitter_token)
    done = command("evaluations", "fetch", evaluation, "--out", str(folder), *access)
    assert f"2 records in {folder}" in done.stdout, done.stderr
    paths = [path for path in sorted(folder.rglob("*.json")) if path.name != "evaluation.json"]
    assert [path.name for path in paths] == ["morning-s3.json", "morning-s4.json"]
    verified = command("verify", str(paths[0]), "--signature-only", "--json")
    told = json.loads(verified.stdout)
    assert told["expected"] == json.loads(paths[0].read_text())["record_hash"]
    key = told["signature"]["key"]
    assert command("verify", str(paths[1]), "--signature-only", "--key", key).exit_code == 0
    with pytest.raises(InvalidInputError, match="cannot be driven again"):
        raise command("verify", str(paths[0])).exception
    better = json.loads(paths[0].read_text()) | {"plans": 3}
    paths[0].write_text(json.dumps(better))
    with pytest.raises(InvalidInputError, match="has been changed"):
        raise command("verify", str(paths[0]), "--signature-only").exception
    sealed = MorningRecord.model_validate(better).sealed()
    paths[0].write_text(sealed.model_dump_json())
    with pytest.raises(InvalidInputError, match="of another record"):
        raise command("verify", str(paths[0]), "--signature-only").exception


@pytest.mark.slow
def test_a_bad_plan_is_refused_and_a_failed_planner_is_the_agents_fault(client: Client, service: Service) -> None:
    evaluation = service.submit(planner("failing"), benchmark(1))
    with WorkerSession(service.url, service.token, "failing") as session:
        drive = None
        while drive is None:
            drive = session.acquire()
        assert (drive.spec["control"], drive.missions) == ("target_speeds", {})
        speeds = drive.observations["planner"]["speeds"]
        assert speeds.max() < FASTEST_MPS  # all segments have reported before the first plan
        with pytest.raises(
            BadActionError, match=r"expected a list of 5 lists of .* numbers, got a list of 5 lists of 5 numbers"
        ):
            session.step(drive, {"planner": speeds[:, :5]})
        session.release(drive, "invalid_action", "ran out of ideas")
    assert service.wait(evaluation).status is EvaluationStatus.DONE
    (episode,) = service.episodes(evaluation)
    assert client.record(episode.id)["failure"] == "ran out of ideas"
    assert episode.summary is not None
    facts = episode.summary["egos"][0]
    assert (facts["status"], facts["failure"]) == ("failed: agent's action was invalid", "ran out of ideas")


def test_orders_that_nobody_plans_close_nothing_for_anybody(service: Service, client: Client) -> None:
    """Each waits in the queue of its owner, takes no process, and can be cancelled."""
    waiting = [service.submit(planner(f"idle-{number}"), benchmark(1), seeds=range(3)) for number in range(12)]
    other = service.submit(planner("busy"), benchmark(1), owner="somebody-else")
    with WorkerSession(service.url, service.other_token, "busy") as session:
        drive = None
        while drive is None:
            drive = session.acquire()
        while not drive.done:
            speeds = drive.observations["planner"]["speeds"]
            session.step(drive, {"planner": np.full_like(speeds, 30.0)})
    assert service.wait(other).status is EvaluationStatus.DONE
    for one in waiting:
        assert client.cancel(one)["status"] == "cancelled"
        client.resume(one)
        assert client.get(f"/v1/evaluations/{one}")["status"] == "queued"


@pytest.mark.slow
def test_an_uploaded_planner_plans_as_a_worker_does(client: Client, service: Service, tmp_path: Path) -> None:
    """Both ask for the speeds that are, up to 30 m/s."""
    shape = {"speeds": plan_shape()}
    clip = helper.make_node("Clip", ["speeds", "low", "high"], ["action"])
    limits = {"low": np.array(0.0, np.float32), "high": np.array(30.0, np.float32)}
    path = tmp_path / "planner.onnx"
    path.write_bytes(
        model([clip], inputs=shape, outputs={"action": plan_shape()}, constants=limits).SerializeToString()
    )
    client.ensure_agent("uploaded", "")
    spec = {key: PLANNER[key] for key in ("track", "sensors", "control")}
    made = client.submit_onnx("uploaded", path, spec)
    info = AgentInfo.model_validate({key: made[key] for key in ("name", "entry", "settings")} | spec | {"kind": "onnx"})
    ordered = service.submit(info, benchmark(1), kind=AgentKind.ONNX, seeds=(5,))
    by_worker = service.submit(planner("clip"), benchmark(1), seeds=(5,))
    with WorkerSession(service.url, service.token, "clip") as session:
        drive = None
        while drive is None:
            drive = session.acquire()
        while not drive.done:
            session.step(drive, {"planner": np.clip(drive.observations["planner"]["speeds"], 0.0, 30.0)})
    uploaded, remote = (
        MorningRecord.model_validate(client.record(service.episodes(one)[0].id))
        for one in (ordered, by_worker)
        if service.wait(one).status is EvaluationStatus.DONE
    )
    assert uploaded.failure is None
    assert (uploaded.outcome, uploaded.plans) == (remote.outcome, remote.plans)
    assert (uploaded.agent.kind, remote.agent.kind) == ("onnx", "remote")


@pytest.fixture
def drives_nothing(tmp_path: Path) -> Iterator[Harness]:
    with running(tmp_path / "data") as harness:
        yield harness


def test_planners_plan_and_drivers_drive(drives_nothing: Harness) -> None:
    team = drives_nothing.caller("team")
    for name in ("mine", "driver"):
        team.post("/v1/agents", {"name": name})
    for wrong in ({"track": "map"}, {"sensors": ["speedometer"]}, {"sensors": ["speeds", "speeds"]}):
        assert_problem(team.post("/v1/agents/mine/submissions", PLANNER | wrong), 422, "planner of freeway mornings")
    assert team.post("/v1/agents/mine/submissions", PLANNER).status_code == 201
    assert team.post("/v1/agents/driver/submissions", {"kind": "remote"}).status_code == 201
    assert_problem(team.post("/v1/evaluations", {"agent": "mine", "benchmark": "quickstart"}), 422, "drive cars")
    assert_problem(team.post("/v1/evaluations", {"agent": "driver", "benchmark": "dissipation"}), 422, "planners")
    ordered = team.post("/v1/evaluations", {"agent": "mine", "benchmark": "dissipation", "ranked": True})
    assert ordered.status_code == 201, ordered.text
    assert ordered.json()["progress"]["total"] == 10
    manifest = team.get(f"/v1/evaluations/{ordered.json()['id']}/manifest").json()
    assert (manifest["agent"]["name"], manifest["benchmark"]["name"]) == ("mine", "dissipation")
    board = team.get("/v1/leaderboard", params={"benchmark": "dissipation"}).json()
    assert (board["metric"], board["rows"]) == ("speed_std_mps", [])
    listed = {one["name"]: one for one in team.get("/v1/benchmarks").json()}
    assert (listed["dissipation"]["kind"], listed["quickstart"]["kind"]) == ("freeway", "driving")


def test_the_most_even_traffic_is_first_on_the_board(drives_nothing: Harness) -> None:
    """And a run with a morning that its planner failed has no place."""
    team = drives_nothing.caller("team")
    for name, deviation in (("rough", 9.0), ("smooth", 5.0), ("failed", None)):
        team.post("/v1/agents", {"name": name})
        team.post(f"/v1/agents/{name}/submissions", PLANNER)
        order = {"agent": name, "benchmark": "dissipation", "ranked": True}
        plan(drives_nothing.services.database, team.post("/v1/evaluations", order).json()["id"], deviation)
    board = team.get("/v1/leaderboard", params={"benchmark": "dissipation"}).json()
    assert [(row["agent"], row["rank"]) for row in board["rows"]] == [("smooth", 1), ("rough", 2)]
    assert [row["scores"]["speed_std_mps"]["mean"] for row in board["rows"]] == pytest.approx([5.45, 9.45])
    assert "driving_score" not in board["rows"][0]["scores"]


def test_traffic_that_creeps_has_no_rank(drives_nothing: Harness) -> None:
    """A plan of 8 m/s everywhere is more even than the best planner's traffic, and a third less of it passes."""
    team = drives_nothing.caller("team")
    for name, deviation, throughput in (("even", 7.6, 3824.0), ("planner", 9.4, 5440.0)):
        team.post("/v1/agents", {"name": name})
        team.post(f"/v1/agents/{name}/submissions", PLANNER)
        order = {"agent": name, "benchmark": "dissipation", "ranked": True}
        evaluation = team.post("/v1/evaluations", order).json()["id"]
        plan(drives_nothing.services.database, evaluation, deviation, throughput)
    rows = team.get("/v1/leaderboard", params={"benchmark": "dissipation"}).json()["rows"]
    told = [(row["agent"], row["rank"], row["unranked"]) for row in rows]
    assert told == [("planner", 1, None), ("even", None, "low_throughput")]


def test_benchmarks_without_a_least_throughput_are_as_before() -> None:
    found = load_freeway_benchmark("dissipation")
    without = found.model_copy(update={"least_throughput_vph": 0.0})
    assert "least_throughput_vph" not in without.model_dump(mode="json")
    assert without.sha256 != found.sha256


def plan(database: Database, evaluation_id: str, deviation: float | None, throughput: float = 5500.0) -> None:
    """Ends a run as if it had been driven, with a deviation of speed that grows with the seed; None: it failed."""
    with database.session() as session:
        for episode in session.scalars(select(Episode).where(Episode.evaluation_id == evaluation_id)):
            measures = dict.fromkeys(MORNING_SCORES, 1.0) | {
                "speed_std_mps": (deviation or 0.0) + 0.1 * episode.seed,
                "throughput_vph": throughput,
            }
            record = MorningRecord(
                scenario=MorningScenario(benchmark=benchmark(1), seed=episode.seed),
                benchmark=("dissipation", "0"),
                agent=planner("p"),
                failure="it broke" if deviation is None else None,
                outcome={} if deviation is None else measures,
            )
            episode.summary, episode.record_hash = summary_of_morning(record), record.content_hash()
        session.get_one(Evaluation, evaluation_id).dohyo_versions = ["0.2.0"]
    finish(database, evaluation_id, EvaluationStatus.DONE, EpisodeStatus.DONE)


@pytest.mark.parametrize(
    ("action", "message"),
    [
        (np.zeros((2, 3)), r"expected finite target speeds \(2, 4\)"),
        (np.full((2, 4), np.nan), "expected finite"),
        (np.full((2, 4), -1.0), "expected target speeds of 0 to 45"),
        (np.full((2, 4), 90.0), "got 90 to 90"),
    ],
)
def test_plans_are_checked(action: np.ndarray, message: str) -> None:
    with pytest.raises(InvalidInputError, match=message):
        checked(action, (2, 4))


def test_a_vehicle_near_its_leader_is_left_to_its_driver() -> None:
    rows = {"v1": [20.0, 14.9, 20.0, 15.0], "v2": [20.0, 15.1, 20.0, 15.0], "v3": [20.0, 80.0, 0.0, 0.0]}
    seen = {name: np.array([*row, 0, 0, 0, 0], dtype=np.float32) for name, row in rows.items()}
    seen |= {"planner": np.ones((2, 4), np.float32), "forecaster": np.ones((8, 3), np.float32)}
    told = vehicles(seen)
    assert [*told] == ["v2"]  # v1 is too close, v3 has no plan
    np.testing.assert_allclose(told["v2"], [15.0])


def test_a_policy_that_cannot_be_loaded_is_a_fault_of_the_agent(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A morning that the infrastructure lost would be driven again at no cost."""
    content = b"no model at all"
    monkeypatch.setenv("DOHYO_POLICIES", str(tmp_path))
    sha256 = hashlib.sha256(content).hexdigest()
    (tmp_path / f"{sha256}.onnx").write_bytes(content)
    settings = {"sha256": sha256, "track": "privileged", "sensors": ["speeds"], "control": "target_speeds"}
    order = EpisodeOrder(
        scenario=MorningScenario(benchmark=benchmark(1), seed=3),
        info=planner("broken").model_copy(update={"settings": settings}),
        benchmark=("night", "0"),
        directory=tmp_path,
        stem="morning-s3",
        act_deadline_s=10.0,
    )
    with tempfile.TemporaryFile() as shared:
        shared.truncate(GAUGE_BYTES)
        gauge = Gauge(shared.fileno())
    drive_morning(order, order.scenario, None, gauge)  # type: ignore[arg-type]  # no worker, no channel
    record = MorningRecord.read(tmp_path / "morning-s3.json")
    assert "protobuf parsing failed" in (record.failure or "")
    assert (record.plans, record.outcome) == (0, {})
    assert is_agent_fault(record)
