"""Mornings on the freeway over HTTP: a planner in a process of its own, and what is refused."""

from __future__ import annotations

import json
import subprocess
import sys
from typing import Any

import numpy as np
import pytest

from dohyo.evaluation.freeway.benchmark import TrafficBenchmark, load_freeway_benchmark
from dohyo.service.client.client import Client, ServiceError
from dohyo.service.client.worker_session import BadActionError, WorkerSession
from dohyo.service.freeway.child import FASTEST_MPS, checked, last_report, vehicles
from dohyo.sumo_networks.errors import InvalidInputError
from tests.service.served import ROOT, Service, wait_until


@pytest.fixture(scope="module")
def service(running_service: Service) -> Service:
    return running_service


@pytest.fixture(scope="module")
def client(service: Service) -> Any:
    with Client(service.url, service.submitter_token) as one:
        one.register_agent("planner")
        yield one


def status(client: Client, name: str) -> str:
    return str(client.morning(name)["status"])


@pytest.mark.slow
def test_a_planner_in_a_process_of_its_own(client: Client, service: Service) -> None:
    name = client.begin_morning("planner", seed=3, minutes=2)["id"]
    assert status(client, name) == "waiting"
    command = [sys.executable, "examples/planner.py", service.url, service.token, "planner", "1"]
    worker = subprocess.run(command, cwd=ROOT, env={"PYTHONPATH": str(ROOT)}, timeout=300, capture_output=True)
    assert worker.returncode == 0, worker.stderr.decode()
    benchmark = load_freeway_benchmark("dissipation")
    assert isinstance(benchmark, TrafficBenchmark)
    told = [f"{(benchmark.start_s + 60 * minute) / 3600:.2f} h" for minute in (1, 2)]
    assert worker.stdout.decode().splitlines() == told
    wait_until(lambda: status(client, name) == "finished", "the morning does not end")
    outcome = client.morning(name)["outcome"]
    assert outcome["throughput_vph"] > 3000
    assert outcome["travelled_km"] > 100


@pytest.mark.slow
def test_a_bad_plan_is_refused_and_a_failed_planner_fails_the_morning(client: Client, service: Service) -> None:
    name = client.begin_morning("planner", minutes=1)["id"]
    with WorkerSession(service.url, service.token, "planner") as session:
        drive = None
        while drive is None:
            drive = session.acquire()
        assert (drive.spec["control"], drive.missions) == ("target_speeds", {})
        speeds = drive.observations["planner"]["speeds"]
        with pytest.raises(
            BadActionError, match="expected a list of 5 lists of .* numbers, got a list of 5 lists of 5 numbers"
        ):
            session.step(drive, {"planner": speeds[:, :5]})
        session.release(drive, "the planner failed", "ran out of ideas")
    wait_until(lambda: status(client, name) == "failed", "the morning does not end")
    assert "ran out of ideas" in client.morning(name)["detail"]


def test_orders_are_checked(client: Client, service: Service) -> None:
    for agent, minutes, code in (("nobody", None, 404), ("planner", 0.0, 422)):
        with pytest.raises(ServiceError) as told:
            client.begin_morning(agent, minutes=minutes)
        assert told.value.status == code
    for name in ("fm-0123456789abcdef", "..%2Fdohyo", "fm-x"):
        with pytest.raises(ServiceError) as told:
            client.morning(name)
        assert told.value.status == 404
    with Client(service.url, service.token) as worker, pytest.raises(ServiceError) as told:
        worker.begin_morning("planner")
    assert told.value.status == 403


def test_what_was_waiting_when_the_service_ended_is_lost(service: Service, client: Client) -> None:
    folder = service.data / "freeway"
    folder.mkdir(exist_ok=True)
    facts = {"agent": "planner", "benchmark": "dissipation", "version": "0", "seed": 1, "owner": "owner"}
    left = facts | {"status": "waiting", "detail": "", "outcome": None}
    (folder / "fm-00000000000000ff.json").write_text(json.dumps(left))
    assert status(client, "fm-00000000000000ff") == "lost"


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


def test_the_forecaster_takes_the_last_report_however_old() -> None:
    history = np.array([[-1.0, 20.0, 10.0], [-1.0, -1.0, 12.0]], dtype=np.float32)
    np.testing.assert_allclose(last_report(history), [FASTEST_MPS, 20.0, 12.0])


def test_a_vehicle_near_its_leader_is_left_to_its_driver() -> None:
    rows = {"v1": [20.0, 14.9, 20.0, 15.0], "v2": [20.0, 15.1, 20.0, 15.0], "v3": [20.0, 80.0, 0.0, 0.0]}
    seen = {name: np.array([*row, 0, 0, 0, 0], dtype=np.float32) for name, row in rows.items()}
    seen |= {"planner": np.ones((2, 4), np.float32), "forecaster": np.ones((8, 3), np.float32)}
    told = vehicles(seen)
    assert [*told] == ["v2"]  # v1 is too close, v3 has no plan
    np.testing.assert_allclose(told["v2"], [15.0])
