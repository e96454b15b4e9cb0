"""`dohyo worker` and the example workers, as their users start them, against a service."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path
from urllib.request import urlopen

import pytest

from dohyo.evaluation.agent import make_agent
from dohyo.evaluation.benchmarks.benchmark import load_benchmark
from dohyo.evaluation.episode.runner import run_episode
from dohyo.evaluation.records.record import AgentInfo
from dohyo.evaluation.records.specifications import Status
from dohyo.service.client.async_client import AsyncClient
from dohyo.service.client.client import Client
from dohyo.service.client.errors import ServiceError
from dohyo.service.client.worker import Driver, work
from dohyo.service.client.worker_session import WorkerSession
from dohyo.service.evaluations.model import EpisodeStatus
from dohyo.service.submissions.model import AgentKind
from dohyo.sumo_networks.errors import InvalidInputError
from tests.forked import Python, dohyo
from tests.service.conftest import MakeService
from tests.service.served import ROOT, STEADY, Service, info_of, short, wait_until

AGENTS = "tests.evaluation.agents"
NODE = shutil.which("node")


@pytest.fixture(scope="module")
def service(running_service: Service) -> Service:
    return running_service


def dohyo_worker(service: Service, agent: str, *options: str, token: str = "") -> Python:
    environment = os.environ | {"DOHYO_TOKEN": token or service.submitter_token}
    return dohyo("worker", "--server", service.url, "--agent", agent, *options, env=environment)


@pytest.fixture
def ended() -> list[subprocess.Popen[bytes] | Python]:
    """Processes that are ended after the test."""
    processes: list[subprocess.Popen[bytes] | Python] = []
    yield processes  # type: ignore[misc]
    for process in processes:
        if process.poll() is None:
            process.kill()
        process.wait()


@pytest.mark.slow
@pytest.mark.parametrize(
    "command",
    [
        pytest.param([sys.executable, "examples/worker_stdlib.py"], id="python"),
        pytest.param(
            [NODE or "node", "examples/worker.mjs"], id="node", marks=pytest.mark.skipif(not NODE, reason="no node")
        ),
    ],
)
def test_the_example_workers_drive_the_quickstart(
    service: Service, command: list[str], ended: list[subprocess.Popen[bytes] | Python]
) -> None:
    name = Path(command[1]).suffix.strip(".")
    info = AgentInfo(name=name, entry=name, track="map", sensors=("route",), control="target_speed_steering")
    quickstart = load_benchmark("quickstart")
    one = quickstart.model_copy(update={"missions": {"all": quickstart.missions["all"][4:5]}})
    evaluation = service.submit(info, one)
    ended.append(subprocess.Popen([*command, service.url, service.token, name], cwd=ROOT))
    (ego,) = service.record(evaluation).egos
    assert ego.progress_m > 0.5 * ego.route_length_m, ego.status
    assert ego.outside_lanes_m < 5.0


@pytest.mark.slow
def test_dohyo_worker_submits_drives_and_gives_back_when_it_is_stopped(
    service: Service, ended: list[subprocess.Popen[bytes] | Python]
) -> None:
    worker = dohyo_worker(service, "cli-steady", "--entry", STEADY)
    ended.append(worker)
    with Client(service.url, service.submitter_token) as client:
        wait_until(
            lambda: any(one["version"] for one in client.items("/v1/agents") if one["name"] == "cli-steady"),
            "it is not submitted",
        )
        (submission,) = client.items("/v1/agents/cli-steady/submissions")
        assert (submission["kind"], submission["entry"]) == ("remote", STEADY)
        benchmark = load_benchmark("quickstart")
        evaluation = client.evaluate("cli-steady", "quickstart", seeds=[0])
        service.wait_done(evaluation["id"], 1)
        first = next(one for one in client.episodes(evaluation["id"]) if one["status"] == "done")
        record = client.record(first["id"])
    info = info_of(STEADY).model_copy(update={"kind": "remote"})
    assert AgentInfo.model_validate(record["egos"][0]["agent"]) == info
    local = run_episode(
        benchmark.scenarios([0])[first["position"]],
        {"ego": make_agent(STEADY)},
        infos={"ego": info},
        benchmark=(benchmark.name, benchmark.sha256),
    )
    assert first["record_hash"] == local.record_hash
    worker.send_signal(signal.SIGTERM)
    assert worker.wait(120) == 0
    again = dohyo_worker(service, "cli-steady", "--entry", STEADY, "--episodes", "1", token=service.token)
    ended.append(again)
    with Client(service.url, service.submitter_token) as client:
        assert again.wait(300) == 0
        progress = client.evaluation(evaluation["id"])["progress"]
        assert progress["done"] >= 2
        assert progress["lost"] == 0
        client.cancel(evaluation["id"])
        assert len(list(client.items("/v1/agents/cli-steady/submissions"))) == 1


def test_what_an_agent_does_wrong_is_recorded_as_if_it_had_been_evaluated_here(service: Service) -> None:
    benchmark = short()
    for name in ("Raises", "AnswersNan", "AnswersNothing", "FailsInReset"):
        entry = f"{AGENTS}:{name}"
        settings = {"after": 3} if name != "FailsInReset" else {}
        info = info_of(entry, **settings).model_copy(update={"name": name})
        evaluation = service.submit(info, benchmark)
        work(WorkerSession(service.url, service.token, name), Driver(entry, settings), episodes=1)
        (ego,) = service.record(evaluation).egos
        local = run_episode(
            benchmark.scenarios([0])[0],
            {"ego": make_agent(entry, settings)},
            infos={"ego": info},
            benchmark=(benchmark.name, benchmark.sha256),
        ).egos[0]
        assert ego.failure == local.failure
        if name != "FailsInReset":  # the wire does not tell reset from the first decision
            assert ego.status is local.status


def test_an_agent_that_hangs_in_a_worker_is_too_slow(service: Service) -> None:
    entry = f"{AGENTS}:Hangs"
    info = info_of(entry, after=3).model_copy(update={"name": "hangs"})
    evaluation = service.submit(info, short(), act_deadline_s=0.5)
    work(WorkerSession(service.url, service.token, "hangs"), Driver(entry, {"after": 3}), episodes=1)
    (ego,) = service.record(evaluation).egos
    assert (ego.status, ego.failure) == (Status.AGENT_DEADLINE, "agent 'hangs' took longer than 0.5 s")


def test_a_worker_with_another_agent_than_was_submitted_gives_the_episode_back(service: Service) -> None:
    info = info_of(STEADY).model_copy(update={"name": "other", "sensors": ("navigation",)})
    evaluation = service.submit(info, short())
    with pytest.raises(InvalidInputError, match="was submitted with sensors"):
        work(WorkerSession(service.url, service.token, "other"), Driver(STEADY))
    assert service.episodes(evaluation)[0].status in (EpisodeStatus.RUNNING, EpisodeStatus.QUEUED)
    assert service.episodes(evaluation)[0].attempts <= 1


@pytest.mark.slow
def test_a_worker_outlives_the_service_and_goes_on_with_the_next(
    make_service: MakeService, ended: list[subprocess.Popen[bytes] | Python]
) -> None:
    service, benchmark, info = make_service(), short(missions=3), info_of(STEADY)
    evaluation = service.submit(info, benchmark)
    service.start()
    ended.append(dohyo_worker(service, "steady", "--entry", STEADY, "--capacity", "2"))
    service.wait_done(evaluation, 1)
    service.kill()
    service.start()
    source = (benchmark.name, benchmark.sha256)
    assert service.hashes(evaluation) == [
        run_episode(one, {"ego": make_agent(STEADY)}, infos={"ego": info}, benchmark=source).record_hash
        for one in benchmark.scenarios([0])
    ]
    ended[0].send_signal(signal.SIGTERM)
    assert ended[0].wait(120) == 0


async def _async_tour(service: Service) -> None:
    async with AsyncClient(service.url, service.submitter_token) as client:
        await client.register_agent("async-steady")
        submitted = await client.submit_builtin("async-steady", "reckless")
        assert submitted["version"] == 1
        evaluation = await client.evaluate("async-steady", "quickstart", seeds=[0])
        assert (await client.cancel(evaluation["id"]))["status"] == "cancelled"
        assert (await client.wait(evaluation["id"], 120))["status"] == "cancelled"
        assert {episode["status"] async for episode in client.episodes(evaluation["id"])} == {"cancelled"}


def test_the_clients_submit_cancel_resume_and_read(service: Service, tmp_path: Path) -> None:
    import asyncio

    asyncio.run(_async_tour(service))
    with Client(service.url, service.submitter_token) as client:
        with pytest.raises(ServiceError, match="404") as caught:
            client.evaluation("ev-nothing")
        assert caught.value.status == 404
        assert client.get("/v1/me")["owner"] == "owner"
    evaluation = service.submit(info_of(STEADY).model_copy(update={"name": "read"}), short(), kind=AgentKind.BUILTIN)
    with Client(service.url, service.submitter_token) as client:
        assert [state["status"] for state in client.follow(evaluation)][-1] == "done"
        (path,) = client.download(evaluation, tmp_path / "records")
    assert json.loads(path.read_text())["record_hash"] == service.hashes(evaluation)[0]
    with pytest.raises(ServiceError, match="no answer"), Client("http://127.0.0.1:9", None, timeout_s=2) as client:
        client.get("/v1/me")


def test_the_wire_is_described(service: Service) -> None:
    with urlopen(f"{service.url}/openapi.json", timeout=120) as answer:
        paths = json.load(answer)["paths"]
    step = paths["/v1/leases/{lease}/step"]["post"]
    assert {"200", "401", "409", "410", "413", "422"} <= set(step["responses"])
    assert "application/msgpack" in step["responses"]["200"]["content"]
    assert step["requestBody"]["content"]["application/json"]["example"]["actions"]
