"""Attack: a worker on the track `sensors` looks for the scenario that it drives, to simulate the same world ahead.

Benchmarks are public and the world is deterministic, so the network, the mission and the seed would be enough.
"""

from __future__ import annotations

import hmac
import json
from typing import Any

import httpx
import pytest

from dohyo.evaluation.benchmarks.benchmark import Benchmark, load_benchmark
from dohyo.evaluation.records.record import AgentInfo
from dohyo.sumo_networks.scenario import Scenario
from tests.service.served import STEADY, Service, info_of, short, wait_until
from tests.service.workers.wire_worker import JSON, WireWorker, hire

SENSORS = ("speedometer", "navigation")
DRIVEN = {"lease", "seed", "observations"}


@pytest.fixture(scope="module")
def service(running_service: Service) -> Service:
    return running_service


def blind(name: str, track: Any = "sensors") -> AgentInfo:
    return info_of(STEADY).model_copy(update={"name": name, "track": track, "sensors": SENSORS})


def elsewhere() -> Benchmark:
    """A short drive on another network than that of `short`."""
    nocrash = load_benchmark("nocrash")
    cell = nocrash.cells[0]
    (mission, *_) = nocrash.missions[cell.missions]
    return short(name="elsewhere").model_copy(
        update={
            "cells": (short().cells[0].model_copy(update={"network": cell.network}),),
            "missions": {"all": (mission,)},
        }
    )


def granted(service: Service, info: AgentInfo, benchmark: Benchmark, seed: int) -> tuple[WireWorker, dict[str, Any]]:
    """An episode, and the worker that holds it."""
    service.submit(info, benchmark, seeds=(seed,))
    worker = hire(service, info.name, JSON)
    return worker, worker.acquire()


def names_of(scenario: Scenario) -> set[str]:
    """Texts that tell a scenario from others."""
    missions = [text for one in scenario.missions for text in (one.start.lane, one.goal.lane, *one.via)]
    return {scenario.name, scenario.network, scenario.cell, *missions}


def texts_in(value: Any) -> set[str]:
    """All texts of a document."""
    if isinstance(value, dict):
        return set().union(value, *map(texts_in, value.values()))
    if isinstance(value, list):
        return set().union(*map(texts_in, value))
    return {value} if isinstance(value, str) else set()


def numbers_in(value: Any) -> set[float]:
    """All numbers of a document."""
    if isinstance(value, dict):
        return set().union(*map(numbers_in, value.values()))
    if isinstance(value, list):
        return set().union(*map(numbers_in, value))
    return {value} if isinstance(value, int | float) and not isinstance(value, bool) else set()


def test_the_wire_tells_the_same_of_every_scenario(service: Service) -> None:
    assert short().cells[0].network != elsewhere().cells[0].network
    worlds = [(short(), 7), (short(name="other", goal_m=20.0), 4211), (elsewhere(), 1000)]
    told = []
    for number, (benchmark, seed) in enumerate(worlds):
        worker, episode = granted(service, blind(f"blind-{number}"), benchmark, seed)
        (scenario,) = benchmark.scenarios([seed])
        assert episode["observations"]["ego"].keys() == set(SENSORS)
        assert not texts_in(episode) & names_of(scenario)
        assert seed not in numbers_in({key: value for key, value in episode.items() if key not in DRIVEN})
        assert episode["seed"] != seed
        worker.drive(episode)
        assert not any(name.encode() in worker.sent for name in names_of(scenario) if len(name) > 5)
        told.append({key: value for key, value in episode.items() if key not in DRIVEN})
        told[-1]["spec"] = {key: value for key, value in episode["spec"].items() if key != "name"}
    assert told[0] == told[1] == told[2]


def test_the_told_seed_is_no_function_of_what_the_owner_knows(service: Service) -> None:
    info, seeds = blind("guesser"), []
    for _ in range(2):
        evaluation = service.submit(info, short(), seeds=(7,))
        worker = hire(service, info.name, JSON)
        episode = worker.acquire()
        seeds.append(episode["seed"])
        known = ("", "7", "0", evaluation, info.name, "short", short().sha256)
        guesses = {
            int.from_bytes(hmac.digest(key.encode(), text.encode(), "sha256")[:4], "big") >> 1
            for key in known
            for text in known
        }
        assert episode["seed"] not in guesses
        tick = worker.drive(episode, steps=1)["tick"]
        worker.post(f"/v1/leases/{episode['lease']}/release", {"reason": "once more"})
        again = worker.acquire()
        assert (again["seed"], again["attempt"], tick) == (episode["seed"], 2, 1), "a repetition is the same"
        worker.drive(again)
        service.wait(evaluation)
    assert seeds[0] != seeds[1]


def test_no_answer_says_which_episode_is_driven(service: Service) -> None:
    """The owner's token reads evaluations: an episode that is `running` would name the scenario."""
    info, benchmark = blind("looker"), short(missions=6)
    evaluation = service.submit(info, benchmark)
    worker = hire(service, info.name, JSON)
    owner = {"Authorization": f"Bearer {service.submitter_token}"}
    path = f"{service.url}/v1/evaluations/{evaluation}"
    order = []
    with httpx.Client(headers=owner, timeout=120) as client, client.stream("GET", f"{path}/events") as events:
        for driven in range(6):
            episode = worker.acquire()
            tick = worker.drive(episode, steps=2)["tick"]
            shown = client.get(f"{path}/episodes").json()["items"]
            waiting = [one for one in shown if one["status"] != "done"]
            assert len(waiting) == 6 - driven
            assert len({(one["status"], one["attempts"], one["started"], one["failure"]) for one in waiting}) == 1
            assert client.get(f"{path}/episodes", params={"status": "running"}).json()["items"] == []
            assert len(client.get(f"{path}/episodes", params={"status": "queued"}).json()["items"]) == 6 - driven
            for one in waiting:
                assert client.get(f"{service.url}/v1/episodes/{one['id']}").json()["started"] is None
            worker.drive(episode | {"tick": tick})
            wait_until(lambda: client.get(path).json()["progress"]["done"] > driven, "it is not kept")  # noqa: B023
            done = {one["position"] for one in client.get(f"{path}/episodes?status=done").json()["items"]}
            order.append((done - set(order)).pop())
        assert sorted(order) == list(range(6))
        messages = [json.loads(line[6:]) for line in events.iter_lines() if line.startswith("data: ")]
    assert {one["status"] for one in messages if "episode" in one} <= {"done"}
    assert service.episodes(evaluation)[0].attempts == 1, "the database knows; only the answers hide it"


def test_the_track_privileged_is_told_the_mission_and_no_seed(service: Service) -> None:
    benchmark = short(name="seen")
    worker, episode = granted(service, blind("seer", "privileged"), benchmark, 99)
    (scenario,) = benchmark.scenarios([99])
    (mission,) = episode["missions"]
    assert mission["start"]["lane"] == scenario.missions[0].start.lane
    assert 99 not in numbers_in(episode | {"observations": None})
    worker.drive(episode)
