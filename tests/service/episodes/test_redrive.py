from __future__ import annotations

import hashlib
import math
import random
import signal
import time
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import pytest

from dohyo.agents.experts.autopilot import Autopilot
from dohyo.evaluation.agent import Observation, agent_info
from dohyo.evaluation.benchmarks.benchmark import load_benchmark
from dohyo.evaluation.episode.runner import drive_episode
from dohyo.evaluation.records.record import EpisodeRecord
from dohyo.evaluation.records.store import read_record, seal, write_record
from dohyo.evaluation.records.trajectory import Trajectory
from dohyo.service.accounts.model import Role
from dohyo.service.confinement.runner import run
from dohyo.service.episodes import kinds
from dohyo.service.episodes.explanations import Trace, explanation_at
from dohyo.service.policies.agent import ENTRY, FOLDER_VARIABLE, OnnxPolicy
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.scenario import Mission, Traffic
from tests.forked import Python
from tests.service.harness import patiently
from tests.service.policies import models
from tests.service.served import wait_until
from tests.service.shop import Shop

Driven = tuple[EpisodeRecord, Trajectory, list[dict[str, Any]]]


class Recorded(Autopilot):
    """An autopilot that keeps what it explained."""

    def __init__(self) -> None:
        super().__init__()
        self.said: list[dict[str, Any]] = []

    def reset(self, mission: Mission, seed: int) -> None:
        super().reset(mission, seed)
        self.said.clear()  # decisions of the warm-up

    def act(self, observation: Observation) -> np.ndarray:
        action = super().act(observation)
        self.said.append(told(self.explain()))
        return action


def told(value: Any) -> Any:
    """As JSON can tell it: what is infinite becomes null."""
    if isinstance(value, dict):
        return {key: told(one) for key, one in value.items()}
    return None if isinstance(value, float) and not math.isfinite(value) else value


@pytest.fixture(scope="module")
def driven() -> Driven:
    """Six seconds of the autopilot on an empty road, and what it said."""
    scenario = load_benchmark("quickstart").scenarios([0])[0]
    scenario = scenario.model_copy(update={"traffic": Traffic(vehicles=0, pedestrians=0), "time_limit_s": 6.0})
    agent = Recorded()
    info = agent_info(Autopilot(), "dohyo.agents.experts.autopilot:Autopilot")
    record, trajectory = drive_episode(scenario, {"ego": agent}, infos={"ego": info}, benchmark=("made", "0" * 64))
    return record, trajectory, agent.said


def verified(shop: Shop, episode: str) -> Any:
    """The answer to the order to drive an episode again."""
    ann = shop.token("ann")
    return patiently(lambda prefer: shop.client.post(f"/v1/episodes/{episode}/verify", headers=ann | prefer))


def explained(shop: Shop, episode: str, tick: int, seconds: float = 300.0) -> Any:
    """Asks until there is an answer."""
    until, headers = time.monotonic() + seconds, shop.token("reader", Role.READER)
    while True:
        answer = shop.client.get(f"/v1/episodes/{episode}/explanation", params={"tick": tick}, headers=headers)
        if answer.status_code != 202 or time.monotonic() > until:
            return answer
        assert int(answer.headers["retry-after"]) >= 1
        time.sleep(0.2)


def test_a_drive_is_the_same_again_and_explains_itself(shop: Shop, driven: Driven) -> None:
    record, trajectory, said = driven
    _, (one,) = shop.evaluation(shop.submission("autopilot"), [record], trajectory=trajectory)
    with shop.client:
        assert verified(shop, one).json() == {
            "episode": one,
            "expected": record.record_hash,
            "replayed": record.record_hash,
            "same": True,
        }
        for tick in (0, 17, record.ticks - 1):
            answer = explained(shop, one, tick).json()
            assert answer["explanations"] == {"ego": said[tick]}
            assert answer["ticks"] == record.ticks
        assert explained(shop, one, record.ticks).json()["explanations"] == {}


def test_the_first_question_sets_off_the_drive(shop: Shop, driven: Driven) -> None:
    record, trajectory, said = driven
    _, (one,) = shop.evaluation(shop.submission("autopilot"), [record], trajectory=trajectory)
    with shop.client:
        asked = shop.client.get(f"/v1/episodes/{one}/explanation", params={"tick": 3})
        assert asked.status_code == 401, "nobody drives an episode again without a token"
        first = shop.client.get(f"/v1/episodes/{one}/explanation", params={"tick": 3}, headers=shop.token("ann"))
        assert (first.status_code, first.json()["status"]) == (202, "being found out")
        assert explained(shop, one, 3).json()["explanations"] == {"ego": said[3]}
        cached = shop.client.get(f"/v1/episodes/{one}/explanation", params={"tick": 4})
        assert cached.json()["explanations"] == {"ego": said[4]}
    (kept,) = shop.path(one).parent.glob("*.explanations-*")
    kept.write_bytes(b"damaged")
    with shop.client:
        assert shop.client.get(f"/v1/episodes/{one}/explanation", params={"tick": 3}).status_code == 410
        assert not kept.exists()  # so that the next question makes it again


def test_a_record_that_does_not_come_out_again_is_told(shop: Shop, driven: Driven) -> None:
    record, trajectory, _ = driven
    ego = record.egos[0].model_copy(update={"contacts": 3})
    _, (one,) = shop.evaluation(
        shop.submission("liar"), [record.model_copy(update={"egos": (ego,)})], trajectory=trajectory
    )
    with shop.client:
        answer = verified(shop, one).json()
        assert (answer["same"], answer["replayed"]) == (False, record.record_hash)
        explanation = explained(shop, one, 0)
        assert explanation.status_code == 409
        assert "a different record" in explanation.json()["detail"]


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"entry": "no.such.module:Agent"}, "no installed package registers 'no.such.module:Agent'"),
        ({"source_sha256": "0" * 64}, "agent 'autopilot' has changed since"),
    ],
)
def test_an_agent_that_is_gone_or_changed_proves_nothing(
    shop: Shop, driven: Driven, change: dict[str, str], why: str
) -> None:
    record, trajectory, _ = driven
    ego = record.egos[0]
    ego = ego.model_copy(update={"agent": ego.agent.model_copy(update=change)})
    _, (one,) = shop.evaluation(
        shop.submission("gone"), [record.model_copy(update={"egos": (ego,)})], trajectory=trajectory
    )
    with shop.client:
        for answer in (verified(shop, one), explained(shop, one, 0)):
            assert answer.status_code == 409
            assert why in answer.json()["detail"]


def test_a_redrive_ends_with_its_parent(tmp_path: Path, driven: Driven) -> None:
    record, trajectory, _ = driven
    long = record.model_copy(update={"scenario": load_benchmark("quickstart").scenarios([0])[0]})
    path = write_record(tmp_path, "long", seal(long), trajectory)
    program = """if True:
        import sys, time
        from dohyo.service.confinement import runner
        from dohyo.service.episodes.kinds import LIMITS
        from pathlib import Path
        record = Path(sys.argv[1])
        runner._use = lambda group: (print(group, flush=True), (1, 0))[1]
        runner.run("redrive", {"record": str(record)}, LIMITS, reads=[record])
    """
    parent = Python(program, str(path))
    parent.wait_for(lambda: parent.output().endswith("\n"))
    child = int(parent.output())
    parent.end(signal.SIGKILL)
    wait_until(lambda: not Path(f"/proc/{child}").exists(), "the confined process outlives its parent")
    assert not (tmp_path / "explanations.jsonl.gz").exists()


def test_a_policys_episode_is_driven_again_in_a_process_within_the_confined_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    model = models.model([onnx.helper.make_node("Identity", ["speedometer"], ["action"])]).SerializeToString()
    sha256, other = hashlib.sha256(model).hexdigest(), tmp_path / f"{'0' * 64}.onnx"
    (tmp_path / f"{sha256}.onnx").write_bytes(model)
    other.write_bytes(b"of another tenant")
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path))
    agent = OnnxPolicy(sha256, sensors=["speedometer"])
    scenario = load_benchmark("quickstart").scenarios([0])[0]
    scenario = scenario.model_copy(update={"traffic": Traffic(vehicles=0, pedestrians=0), "time_limit_s": 2.0})
    infos = {"ego": agent_info(agent, ENTRY, agent.settings, "onnx")}
    record, trajectory = drive_episode(scenario, {"ego": agent}, infos=infos, benchmark=("made", "0" * 64))
    agent.close()
    path = write_record(tmp_path, "policy", seal(record), trajectory)
    reads, _ = kinds._needs(path, tmp_path)
    assert other not in reads
    variables = {FOLDER_VARIABLE: str(tmp_path)}
    answer = run("redrive", {"record": str(path)}, kinds.LIMITS, reads=reads, environment=variables)
    assert answer["same"]
    assert answer["replayed"] == read_record(path).record_hash


def test_an_explanation_is_found_without_unpacking_those_after_it(tmp_path: Path) -> None:
    trace, path = Trace(), tmp_path / "trace.gz"
    note = trace.noter("ego")
    note({"first": 1})
    note({"long": random.Random(0).randbytes(1_000_000).hex()})
    trace.write(path)
    path.write_bytes(path.read_bytes()[:600_000])
    assert explanation_at(path, 0) == {"ego": {"first": 1}}
    with pytest.raises(InvalidInputError, match="expected explanations"):
        explanation_at(path, 1)


def test_explanations_that_are_no_json_are_told_as_text(tmp_path: Path) -> None:
    trace = Trace()
    note = trace.noter("ego")
    note({"array": np.array([1.5, 2.0]), "number": np.float32(0.5), "object": Path("x")})
    note({"nan": float("nan"), "near": 1.0})
    endless: dict[str, Any] = {}
    endless["itself"] = endless
    note(endless)
    note(None)
    trace.noter("other")(None)
    trace.write(tmp_path / "trace.gz")
    first = explanation_at(tmp_path / "trace.gz", 0)
    assert first == {"ego": {"array": [1.5, 2.0], "number": 0.5, "object": "x"}, "other": None}
    assert explanation_at(tmp_path / "trace.gz", 1) == {"ego": {"nan": None, "near": 1.0}}
    assert "unreadable" in explanation_at(tmp_path / "trace.gz", 2)["ego"]
    assert explanation_at(tmp_path / "trace.gz", 3) == {"ego": None}
    assert explanation_at(tmp_path / "trace.gz", 4) == {}
    with pytest.raises(InvalidInputError, match="expected explanations"):
        explanation_at(tmp_path / "missing.gz", 0)
