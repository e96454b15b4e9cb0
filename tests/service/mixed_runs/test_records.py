"""Mixed runs in the service's processes: each ego has its agent, and the records are those of `dohyo evaluate`."""

from __future__ import annotations

import json
from pathlib import Path

import httpx

from dohyo.agents.registry import describe_agent, kind_of, resolve
from dohyo.evaluation.benchmarks.benchmark import Benchmark, Cell
from dohyo.evaluation.benchmarks.headline import Headline
from dohyo.evaluation.records.record import AgentInfo
from dohyo.evaluation.running.manifest import MANIFEST, RECORDS
from dohyo.evaluation.running.run import REST, read_result, run_benchmark
from dohyo.service.client.client import Client
from dohyo.service.submissions.model import AgentKind
from dohyo.sumo_networks.scenario import Mission, Place, Traffic
from tests.service.harness import patiently
from tests.service.served import Service
from tests.service.serving import command

BACK, FRONT = (
    Mission(
        name=name,
        start=Place(lane="737320747#3_2", position_m=at_m),
        goal=Place(lane="737320747#4_2", position_m=at_m),
    )
    for name, at_m in (("back", 5.0), ("front", 20.0))
)
TWO = Benchmark(
    name="two",
    description="for tests",
    headline=Headline.DRIVING_SCORE,
    metric="driving score",
    cells=(Cell(name="street", network="ingolstadt", missions="both", together=True, traffic=Traffic(warm_up_s=0.0)),),
    missions={"both": (BACK, FRONT)},  # type: ignore[dict-item]  # pydantic makes scripted missions of them
    seeds=(0,),
)


def described(name: str) -> AgentInfo:
    entry = resolve(name)
    return describe_agent(entry, {}, kind_of(entry, {}))


def test_the_records_are_those_of_dohyo_evaluate_and_so_is_what_is_fetched(
    running_service: Service, tmp_path: Path
) -> None:
    own, other = described("idm"), described("autopilot")
    here = run_benchmark(TWO, {REST: own, "front": other}, out=tmp_path / "here")
    evaluation = running_service.submit(own, TWO, kind=AgentKind.BUILTIN, others={"front": other})
    assert running_service.hashes(evaluation) == [record.record_hash for record in here.records]

    with Client(running_service.url, running_service.submitter_token) as client:
        state, metrics = client.evaluation(evaluation), client.metrics(evaluation)
        (episode,) = client.episodes(evaluation)
        client.download(evaluation, tmp_path / "fetched" / RECORDS)
        manifest = json.dumps(client.manifest(evaluation))
    assert [(ego, one["agent"]) for ego, one in state["egos"].items()] == [("front", other.name)]
    assert [(one["agent"], one["egos"]) for one in metrics["agents"]] == [(own.name, ["back"]), (other.name, ["front"])]
    (met,) = metrics["meetings"]
    assert ([one["agent"] for one in met["agents"]], met["episodes"]) == ([own.name, other.name], 1)
    (tmp_path / "fetched" / MANIFEST).write_text(manifest)
    result = read_result(tmp_path / "fetched")
    assert result.manifest == here.manifest
    assert [record.record_hash for record in result.records] == [record.record_hash for record in here.records]

    access = ("--server", running_service.url, "--token", running_service.submitter_token)
    watched = " ".join(command("evaluations", "watch", evaluation, *access).stdout.split())
    assert "score idm v1 autopilot v1" in watched
    assert "collisions with each other idm v1 autopilot v1 1 0" in watched

    headers = {"authorization": f"Bearer {running_service.submitter_token}"}
    verify = f"{running_service.url}/v1/episodes/{episode['id']}/verify"
    verified = patiently(lambda prefer: httpx.post(verify, headers=headers | prefer, timeout=120))
    assert verified.json()["same"] is True
