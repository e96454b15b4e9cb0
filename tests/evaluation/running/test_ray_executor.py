"""Evaluations on a local Ray cluster: the records are the process pool's, whatever dies."""

from __future__ import annotations

import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dohyo.evaluation.agent import agent_info
from dohyo.evaluation.benchmarks.benchmark import Benchmark
from dohyo.evaluation.benchmarks.headline import Headline
from dohyo.evaluation.records.specifications import Status
from dohyo.evaluation.records.store import read_trajectory
from dohyo.evaluation.running import ray_executor
from dohyo.evaluation.running.executors import ProcessPool
from dohyo.evaluation.running.job import Job
from dohyo.evaluation.running.ray_executor import LOCAL_CLUSTER, RayExecutor
from dohyo.evaluation.running.run import Result, run_benchmark
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.scenario import Mission, Place, Scenario, Traffic
from tests.evaluation.agents import Steady, kill_the_actor

ROOT = Path(__file__).parents[3]
STEADY = "tests.evaluation.agents:Steady"


class KillsItsActorOnce(Steady):
    """Ends the Ray actor above its worker process, as the loss of a machine does."""

    def __init__(self, marker: str) -> None:
        super().__init__(after=10)
        self.marker = Path(marker)

    def misbehave(self) -> np.ndarray:
        if self.seed == 1 and not self.marker.exists():
            self.marker.touch()
            kill_the_actor()
        return np.array([6.0, 0.0])


class StopsItsActorOnce(KillsItsActorOnce):
    """Silences the actor, of which Ray says nothing, as after a link was down."""

    def misbehave(self) -> np.ndarray:
        if self.seed == 1 and not self.marker.exists():
            self.marker.touch()
            kill_the_actor(signal.SIGSTOP)
        return np.array([6.0, 0.0])


class KillsItsActorAlways(Steady):
    def misbehave(self) -> np.ndarray:
        kill_the_actor()
        return np.array([6.0, 0.0])


def benchmark(missions: int = 2) -> Benchmark:
    """Short drives along one street of Ingolstadt, among others."""
    return Benchmark(
        name="short",
        description="for tests",
        headline=Headline.DRIVING_SCORE,
        metric="driving score",
        network="ingolstadt",
        traffic=Traffic(vehicles=10, pedestrians=10, warm_up_s=5.0),
        missions=tuple(
            Mission(
                name=f"drive-{i}",
                start=Place(lane="737320747#3_2", position_m=5.0 + 10 * i),
                goal=Place(lane="737320747#4_2", position_m=40.0),
            )
            for i in range(missions)
        ),
        seeds=(0, 1),
    )


def hashes(result: Result) -> list[str]:
    return [record.record_hash for record in result.records]


@pytest.fixture(scope="module")
def cluster() -> Iterator[Any]:
    """One local cluster for all tests; each would otherwise start its own."""
    ray = pytest.importorskip("ray", reason="Ray is not installed (pip install 'dohyo[cluster]')")
    ray.init(num_cpus=2, log_to_driver=False, logging_level="error", **LOCAL_CLUSTER)
    yield ray
    ray.shutdown()


def test_a_cluster_gives_the_records_of_the_process_pool(cluster: Any, tmp_path: Path) -> None:
    pool = run_benchmark(benchmark(), STEADY, out=tmp_path / "pool", executor=ProcessPool(1))
    ray = run_benchmark(benchmark(), STEADY, out=tmp_path / "ray", executor=RayExecutor())
    assert hashes(ray) == hashes(pool)
    assert len(set(hashes(ray))) == 4
    for path, record in zip(ray.paths, ray.records, strict=True):
        assert read_trajectory(path).sha256() == record.trajectory_sha256
    assert run_benchmark(benchmark(), STEADY, out=tmp_path / "ray", executor=RayExecutor()).resumed == 4


@pytest.mark.parametrize(
    "agent",
    ["tests.evaluation.agents:DiesOnce", f"{__name__}:KillsItsActorOnce", f"{__name__}:StopsItsActorOnce"],
)
def test_what_dies_or_falls_silent_once_is_driven_again(
    cluster: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, agent: str
) -> None:
    monkeypatch.setattr(ray_executor, "BEAT_S", 1.0)
    monkeypatch.setattr(ray_executor, "SILENCE_S", 8.0 if "Stops" in agent else 60.0)
    settings = {"marker": str(tmp_path / "marker")}
    crashed = run_benchmark(
        benchmark(1), agent, settings=settings, out=tmp_path / "crashed", executor=RayExecutor(workers=2)
    )
    assert Path(settings["marker"]).exists()
    whole = run_benchmark(benchmark(1), agent, settings=settings, out=tmp_path / "whole")
    assert hashes(crashed) == hashes(whole)


@pytest.mark.parametrize(
    ("agent", "says"),
    [("tests.evaluation.agents:DiesAlways", "code -9"), (f"{__name__}:KillsItsActorAlways", "Ray lost its worker")],
)
def test_what_always_dies_is_lost_and_not_the_agents_fault(cluster: Any, tmp_path: Path, agent: str, says: str) -> None:
    result = run_benchmark(benchmark(1), agent, seeds=[0], out=tmp_path, executor=RayExecutor(workers=1))
    (ego,) = result.records[0].egos
    assert ego.status is Status.SIMULATION
    assert says in (ego.failure or "")
    assert result.paths[0].exists()


def test_a_scenario_that_nobody_can_drive_ends_the_evaluation(cluster: Any, tmp_path: Path) -> None:
    nowhere = benchmark(1).missions["all"][0].model_copy(update={"goal": Place(lane="737320747#4_2", position_m=1e6)})
    job = Job(
        scenario=Scenario(network="ingolstadt", missions=(nowhere,)),
        infos={nowhere.name: agent_info(Steady(), STEADY)},
        benchmark=None,
        directory=tmp_path,
        stem="nowhere",
        act_deadline_s=10.0,
    )
    with pytest.raises(InvalidInputError) as here:
        list(ProcessPool().run([job]))
    with pytest.raises(InvalidInputError) as there:
        list(RayExecutor().run([job]))
    assert str(there.value) == str(here.value)
    assert not list(tmp_path.iterdir())


def test_an_agent_that_never_returns_is_at_fault_here_too(cluster: Any, tmp_path: Path) -> None:
    hangs = "tests.evaluation.agents:HangsOutsidePython"
    result = run_benchmark(benchmark(1), hangs, seeds=[0], out=tmp_path, executor=RayExecutor(), act_deadline_s=0.5)
    assert result.records[0].egos[0].status is Status.AGENT_DEADLINE


@pytest.mark.slow
def test_the_command_line_starts_and_ends_a_cluster_of_its_own(tmp_path: Path) -> None:
    pytest.importorskip("ray", reason="Ray is not installed (pip install 'dohyo[cluster]')")
    nowhere = evaluate(tmp_path, "--executor", "ray", "--address", "127.0.0.1:9")
    assert nowhere.returncode == 2
    assert "no Ray cluster at '127.0.0.1:9'" in nowhere.stderr
    done = evaluate(tmp_path, "--executor", "ray", "--workers", "1")
    assert done.returncode == 0, done.stderr
    assert len(list((tmp_path / "out" / "records").glob("*.json"))) == 2
    assert not done.stderr


SHORT = """
name = "short"
description = "for tests"
headline = "driving_score"
metric = "driving score"
network = "ingolstadt"
seeds = [0, 1]
[traffic]
vehicles = 10
warm_up_s = 5.0
[[missions]]
name = "drive"
start = { lane = "737320747#3_2", position_m = 5.0 }
goal = { lane = "737320747#4_2", position_m = 40.0 }
"""


def evaluate(folder: Path, *options: str) -> subprocess.CompletedProcess[str]:
    (folder / "short.toml").write_text(SHORT)
    program = "from dohyo.service.cli import main; main()"
    order = ["evaluate", "--agent", STEADY, "--benchmark", str(folder / "short.toml"), "--out", str(folder / "out")]
    return subprocess.run(
        [sys.executable, "-c", program, *order, *options],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
    )


def test_without_ray_there_is_one_clear_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("dohyo.evaluation.running.ray_executor.find_spec", lambda name: None)
    with pytest.raises(InvalidInputError, match=r"pip install 'dohyo\[cluster\]'"):
        RayExecutor()
