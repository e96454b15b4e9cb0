"""Explorers: the same steps wherever they live and whoever is ready first; deaths, cuts, checkpoints, and learners."""

from __future__ import annotations

import io
import json
import os
import signal
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch
from gymnasium.spaces import Box
from tensordict import TensorDict

from dohyo.agents.learning.algorithms.ddpg import Ddpg, DdpgConfig
from dohyo.agents.learning.algorithms.iqn import Iqn, IqnConfig
from dohyo.agents.learning.algorithms.sac import Sac, SacConfig
from dohyo.agents.learning.experience.behaviour import EpisodeMixture, PolicyBehaviour, UncertaintyGate
from dohyo.agents.learning.experience.collector import MAX_LOST
from dohyo.agents.learning.experience.explorers import Explorers, packed
from dohyo.agents.learning.experience.ray_worker import RayWorker
from dohyo.agents.learning.files.report import no_report
from dohyo.agents.learning.gymnasium.task import GYMNASIUM, GymnasiumConfig
from dohyo.agents.learning.runs.trainer import TrainRequest
from dohyo.agents.learning.tasks.curriculum import Curriculum
from dohyo.agents.rlad.training import RladRunConfig
from dohyo.agents.rlad.training import make_learner as make_rlad
from dohyo.sumo_networks.envs.env_rows import EnvError
from dohyo.sumo_networks.envs.worker_process import Host, WorkerProcess
from dohyo.sumo_networks.errors import DohyoError, InvalidInputError, SimulationError
from dohyo.sumo_networks.seeds import training_seed
from tests.agents.learning.killed import killed_and_resumed
from tests.agents.learning.learners import learner, transitions
from tests.agents.learning.problems import BEST_RETURN, LENGTH, STEP, Dial, Point

POINT = "tests.agents.learning.problems:Point-v0"


class Here:
    """A worker in this process: its host carries out a command when the answer is asked for."""

    def __init__(self, number: int, make_host: Callable[[], Host]) -> None:
        self._host, self._order = make_host(), None

    def send(self, *order: Any) -> None:
        self._order = order

    def receive(self) -> Any:
        return self._host.carry_out(*self._order)

    def begin_stop(self) -> None:
        """Nothing runs."""

    def stop(self) -> None:
        """Nothing runs."""


@dataclass(frozen=True)
class Deadly(Point):
    """A point whose process dies with its first step, wherever it is."""

    def make_env(self, rank: int) -> Any:
        env = super().make_env(rank)
        env.step = lambda action: os._exit(3)  # type: ignore[method-assign]
        return env


@dataclass(frozen=True)
class Mined(Point):
    """A point whose process dies where it begins one of every six seeds; its episodes end at once."""

    def make_env(self, rank: int) -> Any:
        env: Any = super().make_env(rank)
        reset, step = env.reset, env.step
        env.reset = lambda *, seed=None, options=None: os._exit(3) if seed % 6 == 0 else reset(seed=seed)
        env.step = lambda action: (*step(action)[:2], False, True, {"success": False, "distance": 0.0})
        return env


@dataclass(frozen=True)
class Halting(Point):
    """A point that goes no further while a file is there."""

    file: str = ""

    def make_env(self, rank: int) -> Any:
        env: Any = super().make_env(rank)
        step = env.step

        def waiting(action: Any) -> Any:
            while Path(self.file).exists():
                time.sleep(0.01)
            return step(action)

        env.step = waiting
        return env


def wander(seen: TensorDict) -> TensorDict:
    """A policy that draws."""
    return TensorDict({"action": STEP * (2.0 * torch.rand(len(seen), 1) - 1.0)}, seen.batch_size)


def unsure(chosen: TensorDict) -> torch.Tensor:
    return torch.rand(len(chosen))


class Nobody(Explorers):
    """Explorers without processes, for what a learner asks of them before it learns."""

    def __init__(self) -> None:
        self._count, self._states = 1, []


@pytest.fixture
def explorers() -> Iterator[Callable[..., Explorers]]:
    """Makes explorers, which are ended after the test."""
    made: list[Explorers] = []

    def make(task: Any, count: int = 2, stretch: int = 8, seed: int = 0, **options: Any) -> Explorers:
        made.append(Explorers(task, seed, count, stretch, **options))
        return made[-1]

    yield make
    for one in made:
        one.close()


def taken(source: Explorers, length: int, behaviour: Any = None) -> TensorDict:
    """(T, N) steps of a round."""
    steps = []
    for _ in source.round(length):
        source.send(behaviour or PolicyBehaviour(wander))
        steps += list(source.received())
    return TensorDict.stack(steps)


def same(one: TensorDict, other: TensorDict) -> bool:
    return bool((one == other).all())


def test_processes_and_hosts_in_this_process_give_the_same_steps(explorers) -> None:
    """So does a slow process: a stretch is counted in steps."""
    here = taken(explorers(Point(), make_worker=Here), 44)
    assert same(taken(explorers(Point()), 44), here)
    slow = explorers(Point(slow_s=0.003), make_worker=lambda rank, host: (Here if rank else WorkerProcess)(rank, host))
    assert same(taken(slow, 44), here)


def test_a_stretch_is_as_long_as_asked_for_and_no_episode_comes_twice(explorers) -> None:
    source = explorers(Point(), count=3)
    steps = taken(source, 2 * LENGTH + 1)
    assert steps.batch_size == (2 * LENGTH + 1, 3)
    assert source.steps == 3 * (2 * LENGTH + 1)
    assert steps["active"].all()
    assert steps["episode"][[0, LENGTH, 2 * LENGTH]].tolist() == [[0, 1, 2], [3, 4, 5], [6, 7, 8]]
    ended = source.finished()
    assert sorted(one.row for one in ended) == [0, 0, 1, 1, 2, 2]
    assert source.finished_count == 6
    assert source.finished() == []


def test_the_actions_of_explorers_and_stretches_are_drawn_apart(explorers) -> None:
    steps = taken(explorers(Point(), make_worker=Here), 16)["action"]
    assert len(set(steps.flatten().tolist())) == steps.numel()


def test_after_a_cut_a_state_goes_on_as_the_run_would(explorers) -> None:
    source, other = explorers(Point(), make_worker=Here), explorers(Point(), make_worker=Here)
    source.cut_at = 32
    first = taken(source, 16)
    assert source.cut
    assert first["next", "truncated"][-1].all()
    source.cut_at = 0
    other.restore(source.state())
    assert (other.steps, other.cut) == (32, True)
    assert same(taken(source, 24), taken(other, 24))
    assert not source.cut
    assert source.state() == other.state()


def test_a_state_of_other_explorers_is_refused(explorers) -> None:
    state = explorers(Point(), count=2, make_worker=Here).state()
    with pytest.raises(InvalidInputError, match="expected one of 3 explorers, got 2"):
        explorers(Point(), count=3, make_worker=Here).restore(state)


@pytest.mark.slow
def test_an_explorer_that_is_killed_loses_its_episode_and_nothing_else(explorers, tmp_path: Path) -> None:
    workers: list[WorkerProcess] = []

    def noted(rank: int, make_host: Callable[[], Host]) -> WorkerProcess:
        workers.append(WorkerProcess(rank, make_host))
        return workers[-1]

    halts = tmp_path / "halts"
    source = explorers(Halting(file=str(halts)), stretch=30, make_worker=noted)
    before = taken(source, 30)
    assert before["episode"][-1].tolist() == [2, 3]
    halts.touch()
    source.round(30)
    source.send(PolicyBehaviour(wander))
    assert workers[0].pid is not None
    os.kill(workers[0].pid, signal.SIGKILL)
    halts.unlink()
    after = TensorDict.stack(list(source.received()))
    assert after["episode"][0].tolist() == [4, 3]
    assert (source.lost_count, source.steps) == (1, 120)


@pytest.mark.slow
def test_an_environment_that_ends_its_process_again_and_again_ends_the_run(explorers) -> None:
    source = explorers(Deadly(), count=1)
    source.round(8)
    source.send(PolicyBehaviour(wander))
    with pytest.raises(SimulationError, match=f"explorer 0 died {MAX_LOST} times in one step"):
        list(source.received())


@pytest.mark.slow
def test_seeds_that_end_a_process_are_passed_also_where_many_are_in_one_stretch(explorers) -> None:
    source = explorers(Mined(), count=1, stretch=60)
    steps = taken(source, 60)
    assert source.steps == 60
    assert source.lost_count > MAX_LOST
    begun = [training_seed(0, episode) for episode in steps["episode"].flatten().tolist()]
    assert len(set(begun)) == 60
    assert all(seed % 6 for seed in begun)


def test_an_error_of_the_task_is_told_and_ends_the_processes(explorers) -> None:
    source = explorers(Point(fragile="raise"))
    source.round(8)
    source.send(PolicyBehaviour(wander))
    with pytest.raises(EnvError, match="the point is lost"):
        list(source.received())


def test_an_environment_that_cannot_be_used_is_told_once(explorers) -> None:
    @dataclass(frozen=True)
    class Flat(Point):
        observation_space = Box(0.0, 1.0, (2, 2), np.float32)

    source = explorers(Flat(), make_worker=Here)
    source.round(8)
    source.send(PolicyBehaviour(wander))
    with pytest.raises(InvalidInputError, match=r"got float32 \(2, 2\)"):
        list(source.received())


def test_lost_simulations_are_counted_and_the_others_go_on(explorers) -> None:
    source = explorers(Point(fragile="crash"), seed=1, make_worker=Here)
    steps = taken(source, 60)
    assert source.lost_count > 0
    assert source.steps == int(steps["active"].sum()) < 120


def test_what_cannot_be_shared_is_refused(explorers) -> None:
    @dataclass(frozen=True)
    class Levels(Point):
        curriculum = Curriculum(3)

    with pytest.raises(InvalidInputError, match="'point' has a curriculum"):
        explorers(Levels(), make_worker=Here)
    with pytest.raises(InvalidInputError, match="got EpisodeMixture"):
        packed(EpisodeMixture(wander, seed=0, share=0.5))
    with pytest.raises(InvalidInputError, match="cannot be sent"):
        packed(PolicyBehaviour(lambda seen: seen))


def test_an_expert_labels_and_drives_where_the_gate_says_so(explorers) -> None:
    steps = taken(explorers(Point(), make_worker=Here), 40, UncertaintyGate(wander, unsure, 0.5))
    assert steps["labelled"].all()
    demonstrated = steps["source"] == 1
    assert 0.2 < demonstrated.float().mean() < 0.8
    assert same(steps["action"][demonstrated], steps["label"][demonstrated])


@pytest.mark.parametrize(
    ("kind", "config", "task"),
    [
        (Sac, SacConfig(learning_starts=0, round_steps=50), Point()),
        (Ddpg, DdpgConfig(learning_starts=0, round_steps=50), Point()),
        (Iqn, IqnConfig(learning_starts=0, round_steps=50, noise=0.5, first_exploration=0.5), Dial()),
    ],
)
def test_a_learner_that_was_sent_chooses_as_the_learner_does(kind, config, task, tmp_path: Path) -> None:
    """And it brings neither replay nor optimiser, whose size would grow with the run."""
    whole = learner(kind, config, task, tmp_path)
    whole.learn(transitions(task, 32))
    small = len(packed(PolicyBehaviour(whole._choose)))
    seen = transitions(task, 4)["observation"]
    sent = torch.load(io.BytesIO(packed(PolicyBehaviour(whole._choose))), weights_only=False)
    torch.manual_seed(5)
    expected = PolicyBehaviour(whole._choose).act(seen, torch.zeros(4), torch.zeros(4))["action"]
    torch.manual_seed(5)
    assert same(sent.act(seen, torch.zeros(4), torch.zeros(4))["action"], expected)
    whole.round()
    assert len(packed(PolicyBehaviour(whole._choose))) < 1.05 * small


def test_sac_learns_from_explorers(tmp_path: Path) -> None:
    sac = SacConfig(hidden=(32, 32), batch=64, learning_rate=1e-2, initial_alpha=0.1, updates_per_step=0.5)
    settings = GymnasiumConfig(
        env=POINT, algorithm="sac", explorers=2, stretch=10, steps=1500, episodes=4, tensorboard=False,
        sac=sac.model_copy(update={"round_steps": 250}),
    )  # fmt: skip
    GYMNASIUM.train(settings, TrainRequest("gymnasium", tmp_path / "run", False, no_report))
    assert json.loads((tmp_path / "run" / "result.json").read_text())["last"]["return"] > 1.5 * BEST_RETURN


@pytest.mark.parametrize("algorithm", ["rlad", "sac-ae", "curl", "drq", "drq-v2"])
def test_learners_from_pictures_can_be_sent(algorithm: str, tmp_path: Path) -> None:
    settings = RladRunConfig.model_validate({"algorithm": algorithm})
    run: Any = SimpleNamespace(folder=tmp_path, config=settings, device=torch.device("cpu"))
    made: Any = make_rlad(settings, Nobody(), run)
    assert packed(made._behaviour)


def test_a_training_that_diverges_ends_before_a_checkpoint_is_written(tmp_path: Path) -> None:
    whole = learner(Sac, SacConfig(learning_starts=0, round_steps=20), Point(), tmp_path)
    whole.learn = lambda batch: {"loss_critic": torch.tensor(float("nan"))}
    with pytest.raises(DohyoError, match="the training has diverged: loss_critic"):
        whole.round()


@pytest.mark.slow
def test_a_run_with_explorers_that_is_killed_and_resumed_is_the_same(tmp_path: Path) -> None:
    settings = [f"env={POINT}", "algorithm=sac", "explorers=2", "stretch=16"]
    sizes = ["steps=2048", "checkpoint_every=256", "evaluate_every=512", "episodes=2", "sac.round_steps=64"]
    killed_and_resumed(
        "gymnasium", [*settings, *sizes, "sac.batch=32", "sac.hidden=[32]", "tensorboard=false"], tmp_path, onnx=False
    )


def test_ppo_has_no_explorers(tmp_path: Path) -> None:
    settings = GymnasiumConfig(env=POINT, algorithm="ppo", explorers=2)
    with pytest.raises(InvalidInputError, match="expected explorers = 0"):
        GYMNASIUM.train(settings, TrainRequest("gymnasium", tmp_path / "run", False, no_report))
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"cluster": "auto"}, "expected explorers of at least 1, got 0"),
        ({"cluster": "127.0.0.1:9", "explorers": 2}, "no Ray cluster at '127.0.0.1:9'"),
    ],
)
def test_a_cluster_that_cannot_be_used_is_refused_before_anything_is_written(
    settings: dict[str, Any], said: str, tmp_path: Path
) -> None:
    if "explorers" in settings:
        pytest.importorskip("ray", reason="Ray is not installed (pip install 'dohyo[cluster]')")
    with pytest.raises(InvalidInputError, match=said):
        GYMNASIUM.train(GymnasiumConfig(env=POINT, **settings), TrainRequest("gym", tmp_path / "run", False, no_report))
    assert not (tmp_path / "run").exists()


@pytest.mark.slow
def test_actors_of_a_ray_cluster_give_the_same_steps_and_a_lost_one_begins_anew(explorers) -> None:
    ray = pytest.importorskip("ray", reason="Ray is not installed (pip install 'dohyo[cluster]')")
    workers: list[Any] = []

    def noted(rank: int, make_host: Callable[[], Host]) -> Any:
        workers.append(RayWorker("local", rank, make_host))
        return workers[-1]

    try:
        source = explorers(Point(), make_worker=noted)
        assert same(taken(source, 44), taken(explorers(Point(), make_worker=Here), 44))
        ray.kill(workers[1]._actor)
        assert taken(source, 8)["active"].all()
        assert source.lost_count == 1
        source.close()  # the cluster may have two processors
        broken = explorers(Point(fragile="raise"), count=1, make_worker=partial(RayWorker, "local"))
        broken.round(8)
        broken.send(PolicyBehaviour(wander))
        with pytest.raises(EnvError, match="the point is lost"):
            list(broken.received())
    finally:
        ray.shutdown()
