"""Parking at a service: all kinds of submission, records that are signed and repeated, kills, and refusals."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest
from sqlalchemy import select

from dohyo.agents.parking.policy_agent import ONE, SHIPPED
from dohyo.agents.registry import resolve
from dohyo.evaluation.parking.benchmark import load_parking_benchmark
from dohyo.evaluation.parking.evaluate import evaluate_parking
from dohyo.evaluation.parking.record import ParkingRecord
from dohyo.evaluation.parking.result import LotCounts
from dohyo.evaluation.records.record import AgentInfo
from dohyo.evaluation.records.specifications import Status
from dohyo.service.client.client import Client
from dohyo.service.client.connection import BadActionError
from dohyo.service.client.errors import ServiceError
from dohyo.service.client.worker import Driver, work
from dohyo.service.client.worker_session import WorkerSession
from dohyo.service.episodes.archive import archived_path
from dohyo.service.evaluations.model import AttemptOutcome, Episode, EpisodeStatus, Evaluation, EvaluationStatus
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.seeds import HELD_OUT_FROM
from tests.service.conftest import MakeService
from tests.service.harness import Harness, assert_problem, finish, patiently, running
from tests.service.served import Service
from tests.service.serving import command

SEEDS = [HELD_OUT_FROM, HELD_OUT_FROM + 1]
PARKER = {"kind": "remote", "track": "sensors", "sensors": ["parking-oriented"], "control": "torque_steering_brake"}
GREEDY = "tests.evaluation.parking.parkers:Greedy"


@pytest.fixture(scope="module")
def service(running_service: Service) -> Service:
    return running_service


@pytest.fixture
def own_service(make_service: MakeService) -> Service:
    service = make_service(processes=1, lease_ttl_s=8.0)
    service.start()
    return service


@pytest.fixture(scope="module")
def client(service: Service) -> Iterator[Client]:
    with Client(service.url, service.submitter_token) as one:
        yield one


def test_a_built_in_agent_parks_as_it_does_locally(client: Client, service: Service, tmp_path: Path) -> None:
    """And its records are signed, fetched, verified and shown."""
    client.ensure_agent("shipped", "")
    client.submit_builtin("shipped", "parking", {})
    evaluation = client.evaluate("shipped", "parking-complex", seeds=SEEDS)["id"]
    hashes = service.hashes(evaluation)
    complex_lots = load_parking_benchmark("parking-complex")
    local = evaluate_parking(complex_lots, resolve("parking"), {}, "builtin", SEEDS, tmp_path / "local")
    assert hashes == [record.record_hash for record in local]
    scores = client.get(f"/v1/evaluations/{evaluation}/metrics")["all"]["scores"]
    parked = [record.karts[0].parked for record in local]
    assert scores["success"]["mean"] == 100.0 * sum(parked) / 2
    assert scores.keys() == {"success", "aligned", "time_s", "contacts", "timed_out"}
    assert verified(service, service.episodes(evaluation)[0].id)["same"]
    for episode, record in zip(service.episodes(evaluation), local, strict=True):
        replay = client.get(f"/v1/episodes/{episode.id}/replay")
        assert replay["egos"][0]["parking"]["ending"] == record.karts[0].ending
        assert len(replay["actors"][0]["x"]) == replay["ticks"] > 10
        assert any(spot["free"] for spot in replay["lot"]["spots"])
        for part, query in (("events", {}), ("explanation", {"tick": 0})):
            with pytest.raises(ServiceError, match="roads") as refused:
                client.get(f"/v1/episodes/{episode.id}/{part}", **query)
            assert refused.value.status == 409
    fetched_lots_are_verified(evaluation, service, tmp_path / "fetched")
    archived_path(service.settings, str(hashes[0])).with_suffix(".parquet").write_bytes(b"PAR1 no more")
    with pytest.raises(ServiceError, match="missing or damaged") as gone:
        client.get(f"/v1/episodes/{service.episodes(evaluation)[0].id}/trajectory")
    assert gone.value.status == 410


def fetched_lots_are_verified(evaluation: str, service: Service, folder: Path) -> None:
    access = ("--server", service.url, "--token", service.submitter_token)
    done = command("evaluations", "fetch", evaluation, "--out", str(folder), *access)
    assert f"2 records in {folder}" in done.stdout, done.stderr
    watched = command("evaluations", "watch", evaluation, *access)
    assert re.search(r"aligned, of successes % .*2 drives; ev-", watched.stdout, re.DOTALL), watched.stdout
    paths = sorted((folder / "records").glob("*.json"))
    assert [path.name for path in paths] == [f"lot-s{seed}.json" for seed in SEEDS]
    told = json.loads(command("verify", str(paths[0]), "--json").stdout)
    assert told["same"]
    assert command("verify", str(paths[1]), "--signature-only", "--key", told["signature"]["key"]).exit_code == 0
    assert "success, %" in command("report", str(folder), "--out", str(folder / "report.html")).stdout
    paths[1].with_suffix(".parquet").unlink()
    with pytest.raises(InvalidInputError, match="expected the motion of parking"):
        raise command("verify", str(paths[1]), "--signature-only").exception
    changed = json.loads(paths[0].read_text()) | {"seed": 5}
    paths[0].write_text(ParkingRecord.model_validate(changed).sealed().model_dump_json())
    with pytest.raises(InvalidInputError, match="of another record"):
        raise command("verify", str(paths[0])).exception


def test_an_uploaded_policy_parks_as_the_file_does_locally(client: Client, service: Service, tmp_path: Path) -> None:
    client.ensure_agent("uploaded", "")
    spec = {"track": "sensors", "sensors": ["parking-oriented"], "control": "torque_steering_brake"}
    made = client.submit_onnx("uploaded", SHIPPED[ONE], spec)
    evaluation = client.evaluate("uploaded", "parking-complex", seeds=SEEDS)["id"]
    service.hashes(evaluation)
    out = tmp_path / "onnx"
    order = (
        "--agent",
        "onnx",
        "--set",
        f"path={SHIPPED[ONE]}",
        "--set",
        "name=uploaded",
        "--benchmark",
        "parking-complex",
    )
    done = command("evaluate", *order, "--seeds", ",".join(map(str, SEEDS)), "--workers", "1", "--out", str(out))
    assert done.exit_code == 0, done.exception
    here = [json.loads(line) for line in (out / "records.jsonl").read_text().splitlines()]
    there = [client.record(episode.id) for episode in service.episodes(evaluation)]
    assert [one["motion_sha256"] for one in there] == [one["motion_sha256"] for one in here]
    assert there[0]["agent"]["settings"]["sha256"] == made["settings"]["sha256"]
    assert verified(service, service.episodes(evaluation)[0].id)["same"]


def test_workers_park_three_karts_as_they_do_locally(client: Client, service: Service, tmp_path: Path) -> None:
    """With observations and actions of all karts in each step."""
    client.ensure_remote("three", AgentInfo(name="greedy", kind="remote", entry=GREEDY, **_facts()))
    evaluation = client.evaluate("three", "parking-three", seeds=SEEDS)["id"]
    work(WorkerSession(service.url, service.token, "three"), Driver(GREEDY), episodes=2)
    service.hashes(evaluation)
    three = load_parking_benchmark("parking-three")
    local = evaluate_parking(three, GREEDY, {}, "local", SEEDS, tmp_path / "local")
    there = [client.record(episode.id) for episode in service.episodes(evaluation)]
    assert [one["karts"] for one in there] == [one.model_dump(mode="json")["karts"] for one in local]
    assert [one["motion_sha256"] for one in there] == [one.motion_sha256 for one in local]
    assert "cannot be driven again" in verified(service, service.episodes(evaluation)[0].id)["detail"]


def test_a_lot_is_driven_again_after_its_worker_and_the_service_were_killed(
    own_service: Service, tmp_path: Path
) -> None:
    """A worker that falls silent costs an attempt; lots that were done stay done."""
    service = own_service
    info = AgentInfo(name="mortal", kind="remote", entry=GREEDY, **_facts())
    simple = load_parking_benchmark("parking-simple")
    evaluation = service.submit(info, simple, seeds=SEEDS)
    work(WorkerSession(service.url, service.token, "mortal"), Driver(GREEDY), episodes=1)
    service.wait_done(evaluation)
    done = next(one for one in service.episodes(evaluation) if one.status is EpisodeStatus.DONE)
    lost = WorkerSession(service.url, service.token, "mortal")
    drive = _acquired(lost)
    lost.step(drive, {"ego": np.zeros(3)})
    service.kill()
    service.start()
    drive = _acquired(lost := WorkerSession(service.url, service.token, "mortal"))
    lost.step(drive, {"ego": np.zeros(3)})  # and is never heard of again
    work(WorkerSession(service.url, service.token, "mortal"), Driver(GREEDY), episodes=1)
    hashes = service.hashes(evaluation)
    assert hashes[done.position] == done.record_hash
    outcomes = [one.outcome for one in service.attempts(evaluation)]
    assert AttemptOutcome.WORKER_GONE in outcomes
    assert outcomes.count(AttemptOutcome.DONE) == 2
    local = evaluate_parking(simple, GREEDY, {}, "local", SEEDS, tmp_path / "local")
    with Client(service.url, service.submitter_token) as client:
        there = [client.record(episode.id)["motion_sha256"] for episode in service.episodes(evaluation)]
    assert there == [one.motion_sha256 for one in local]


@pytest.mark.parametrize(
    ("name", "error", "failure"),
    [("failing", "it hit its head", "it hit its head"), ("silent", "\n", "no reason given")],
)
def test_bad_actions_are_refused_and_a_failed_worker_is_the_agents_fault(
    client: Client, service: Service, name: str, error: str, failure: str
) -> None:
    evaluation = service.submit(
        AgentInfo(name=name, kind="remote", entry=GREEDY, **_facts()), load_parking_benchmark("parking-simple")
    )
    with WorkerSession(service.url, service.token, name) as session:
        drive = _acquired(session)
        assert drive.observations["ego"]["parking-oriented"].shape == (64,)
        for bad, said in ((np.zeros(2), "3 numbers"), (np.array([0.0, np.nan, 0.0]), "finite")):
            with pytest.raises(BadActionError, match=said):
                session.step(drive, {"ego": bad})
        session.step(drive, {"ego": np.array([9.0, 0.0, -9.0])})  # moved into the bounds
        session.release(drive, "the agent failed", error)
    assert service.wait(evaluation).status is EvaluationStatus.DONE
    (episode,) = service.episodes(evaluation)
    (kart,) = client.record(episode.id)["karts"]
    assert (kart["ending"], kart["failure"]) == ("failed", failure)
    assert episode.summary is not None
    assert episode.summary["egos"][0]["status"] == "failed: agent raised"


@pytest.fixture(scope="module")
def drives_nothing(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Harness]:
    with running(tmp_path_factory.mktemp("idle") / "data") as harness:
        yield harness


def test_karts_are_parked_and_cars_are_driven(drives_nothing: Harness) -> None:
    team = drives_nothing.caller("team")
    for name in ("parker", "driver"):
        team.post("/v1/agents", {"name": name})
    wrong = ({"track": "privileged"}, {"sensors": ["speedometer"]}, {"sensors": ["parking-v1", "parking-v2"]})
    for part in wrong:
        assert_problem(team.post("/v1/agents/parker/submissions", PARKER | part), 422, "an agent that parks")
    on_roads = PARKER | {"control": "target_speed_steering"}
    assert_problem(team.post("/v1/agents/driver/submissions", on_roads), 422, "parking-oriented")
    assert team.post("/v1/agents/parker/submissions", PARKER).status_code == 201
    assert team.post("/v1/agents/driver/submissions", {"kind": "remote"}).status_code == 201
    for agent, benchmark in (("parker", "quickstart"), ("driver", "parking-complex"), ("parker", "dissipation")):
        refused = team.post("/v1/evaluations", {"agent": agent, "benchmark": benchmark})
        assert_problem(refused, 422, f"benchmark '{benchmark}': expected", f"'{agent}' has control")
    ordered = team.post("/v1/evaluations", {"agent": "parker", "benchmark": "parking-complex", "ranked": True}).json()
    assert ordered["progress"]["total"] == 2000
    manifest = team.get(f"/v1/evaluations/{ordered['id']}/manifest").json()
    assert (manifest["agent"]["name"], manifest["benchmark"]["scene"]) == ("parker", "complex")
    assert len(manifest["seeds"]) == 2000
    board = team.get("/v1/leaderboard", params={"benchmark": "parking-complex"}).json()
    assert (board["metric"], board["rows"]) == ("success", [])
    assert team.get("/v1/benchmarks/parking-three").json()["kind"] == "parking"
    seen = team.get(
        "/v1/observations", params={**{k: PARKER[k] for k in ("track", "control")}, "sensors": "parking-v1"}
    )
    assert seen.json()["inputs"][0]["shape"] == [54]
    assert seen.json()["outputs"][0]["shape"] == [3]


def test_the_board_ranks_by_success_and_shows_the_aligned_share(drives_nothing: Harness) -> None:
    entrant = drives_nothing.caller("entrant")
    for name, missed_every in (("careless", 8), ("careful", 20)):
        entrant.post("/v1/agents", {"name": name})
        entrant.post(f"/v1/agents/{name}/submissions", PARKER)
        order = {"agent": name, "benchmark": "parking-angled", "ranked": True}
        end_run(drives_nothing, entrant.post("/v1/evaluations", order).json()["id"], missed_every)
    board = entrant.get("/v1/leaderboard", params={"benchmark": "parking-angled"}).json()
    assert [(row["agent"], row["rank"]) for row in board["rows"]] == [("careful", 1), ("careless", 2)]
    assert [row["scores"]["success"]["mean"] for row in board["rows"]] == [95.0, 87.5]
    aligned = board["rows"][0]["scores"]["aligned"]
    assert (aligned["n"], round(aligned["mean"], 1)) == (1900, 52.6)  # every second lot, but for those not parked
    table = entrant.get("/v1/leaderboard.csv", params={"benchmark": "parking-angled"}).text.splitlines()
    assert "success,success_low,success_high,aligned," in table[0]
    assert "driving_score" not in table[0]


def end_run(harness: Harness, evaluation_id: str, missed_every: int) -> None:
    """Ends a run as if a kart had parked in all lots but each so many-th, and stood aligned in each second one."""
    with harness.services.database.session() as session:
        for episode in session.scalars(select(Episode).where(Episode.evaluation_id == evaluation_id)):
            parked = int(episode.position % missed_every != 0)
            lot = LotCounts(1, parked, parked * (episode.position % 2), 1 - parked, 0, [12.0] * parked)
            status = (Status.COMPLETED if parked else Status.COLLIDED).value
            facts = {"name": "lot", "status": status, "km": 0.0, "infractions": {}, "parking": asdict(lot)}
            episode.summary, episode.record_hash = {"egos": [facts]}, f"{episode.position:064x}"
        session.get_one(Evaluation, evaluation_id).dohyo_versions = ["0.2.0"]
    finish(harness.services.database, evaluation_id, EvaluationStatus.DONE, EpisodeStatus.DONE)


def verified(service: Service, episode: str) -> Any:
    """Answer of the job that drives an episode again."""
    allowed, path = {"authorization": f"Bearer {service.submitter_token}"}, f"/v1/episodes/{episode}/verify"
    return patiently(lambda prefer: httpx.post(service.url + path, headers=allowed | prefer, timeout=120.0)).json()


def _facts() -> dict[str, Any]:
    return {"track": "sensors", "sensors": ("parking-oriented",), "control": "torque_steering_brake"}


def _acquired(session: WorkerSession) -> Any:
    drive = None
    while drive is None:
        drive = session.acquire()
    return drive
