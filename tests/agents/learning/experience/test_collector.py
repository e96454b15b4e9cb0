"""The collector: episodes and their seeds, who drives and who is asked, cuts, lost episodes, several agents."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium.spaces import Box, Dict
from tensordict import TensorDict

from dohyo.agents.learning.algorithms.ppo import Ppo
from dohyo.agents.learning.algorithms.ppo_config import PpoConfig
from dohyo.agents.learning.experience.behaviour import (
    DEMONSTRATOR,
    POLICY,
    EpisodeMixture,
    PolicyBehaviour,
    UncertaintyGate,
)
from dohyo.agents.learning.experience.collector import MAX_LOST, Collector
from dohyo.agents.learning.experience.replay import Replay, ReplayConfig
from dohyo.agents.learning.runs.evaluation import evaluate
from dohyo.agents.learning.tasks.curriculum import Curriculum, Progress
from dohyo.agents.learning.tasks.environments import ActionRepeat, FrameStack, check_environments
from dohyo.agents.learning.tasks.task import Env, Environments, Task, check_task, held_out_seeds, named
from dohyo.sumo_networks.envs.local_vector_env import LocalVectorEnv
from dohyo.sumo_networks.errors import InvalidInputError, SimulationError
from dohyo.sumo_networks.seeds import HELD_OUT_FROM, training_seed
from tests.agents.learning.problems import LENGTH, STEP, Lock, Point
from tests.sumo_networks.envs.toys import Pair


def still(observation: TensorDict) -> TensorDict:
    """A policy that stands."""
    return TensorDict({"action": torch.zeros(*observation.batch_size, 1)}, observation.batch_size)


def collector_of(task: Task, rows: int = 2, seed: int = 0) -> Collector:
    return Collector(task.make_environments(rows, processes=False), task, seed)


def taken(collector: Collector, behaviour: Any, steps: int) -> TensorDict:
    """(N, T) steps, as one round."""
    return TensorDict.stack([collector.step(behaviour) for _ in collector.round(steps)], dim=1)


def test_training_seeds_differ_and_are_never_held_out():
    seeds = [training_seed(run, episode) for run in range(5) for episode in range(100)]
    assert len(set(seeds)) == len(seeds)
    assert max(seeds) < HELD_OUT_FROM


def test_a_step_tells_of_the_episode_that_ended_and_the_next_one_begins():
    collector = collector_of(Point())
    steps = taken(collector, PolicyBehaviour(still), LENGTH + 1)
    assert steps["next", "truncated"][:, :, 0].sum(dim=1).tolist() == [1, 1]
    assert steps["next", "truncated"][:, LENGTH - 1].all()
    assert steps["next", "observation", "observation"][:, LENGTH - 1, 1].tolist() == [1.0, 1.0]  # the true last one
    assert steps["observation", "observation"][:, LENGTH, 1].tolist() == [0.0, 0.0]
    assert steps["episode"][:, [0, LENGTH]].tolist() == [[0, 2], [1, 3]]
    for one in collector.finished():
        assert (one.total, one.length, one.success, one.demonstrated) == (-LENGTH, LENGTH, False, 0.0)
        assert one.measures == {"distance": 1.0}
    assert collector.finished() == []
    assert (collector.finished_count, collector.steps) == (2, 2 * (LENGTH + 1))


class Uneven(gymnasium.Wrapper[Any, Any, Any, Any]):
    """A point whose episodes have one of two lengths, which the seed decides."""

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        self.left = LENGTH // (1 + (seed or 0) % 2)
        return self.env.reset(seed=seed, options=options)

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        *step, infos = self.env.step(action)
        self.left -= 1
        return (*step[:3], self.left == 0, infos)


@dataclass(frozen=True)
class UnevenPoint(Point):
    def make_env(self, rank: int) -> Env:
        return Uneven(super().make_env(rank))


def test_rows_that_begin_later_take_the_same_episodes():
    task, lengths = UnevenPoint(), []
    for later in (0, 3):
        collector = Collector(task.make_environments(2, processes=False), task, 0, begin_after=later)
        steps = taken(collector, PolicyBehaviour(still), 4 * LENGTH)
        driven = steps[steps["active"]]
        assert (len(driven) == 2 * 4 * LENGTH) == (later == 0)
        assert collector.steps == len(driven)
        times: dict[int, list[int]] = {}
        for row in steps.unbind(0):
            for one in row[row["active"]].unbind(0):
                time = round(LENGTH * one["observation", "observation"][1].item())
                times.setdefault(int(one["episode"]), []).append(time)
        assert all(taken_at == list(range(len(taken_at))) for taken_at in times.values())
        finished = sorted(times)[:-2]
        lengths.append([len(times[episode]) for episode in finished])
        assert sorted(one.length for one in collector.finished())[:4] == [LENGTH // 2] * 4
    blocking, overlapping = lengths
    assert len(blocking) > len(overlapping) > 4
    assert blocking[: len(overlapping)] == overlapping


def test_the_expert_drives_whole_episodes_as_often_as_asked():
    collector = collector_of(Lock(), rows=4)
    steps = taken(collector, EpisodeMixture(still, seed=3, share=0.3), 300)
    sources = {}
    for episode, source in zip(steps["episode"].flatten().tolist(), steps["source"].flatten().tolist(), strict=True):
        assert sources.setdefault(episode, source) == source
    assert 0.2 < np.mean([source == DEMONSTRATOR for source in sources.values()]) < 0.4
    guided = steps["source"] == DEMONSTRATOR
    assert torch.equal(steps["action"][guided], steps["label"][guided])
    assert (steps["action"][~guided] == 0.0).all()
    assert not steps["labelled"][~guided].any()


def test_to_be_asked_is_not_to_drive():
    steps = taken(collector_of(Point()), PolicyBehaviour(still, labels=True), 5)
    assert steps["labelled"].all()
    assert (steps["source"] == POLICY).all()
    assert (steps["action"] == 0.0).all()
    assert steps["label"].abs().min() == STEP


def test_a_gate_hands_over_where_the_policy_is_uncertain():
    def unsure_on_the_left(chosen: TensorDict) -> torch.Tensor:
        return chosen["doubt"]

    def policy(observation: TensorDict) -> TensorDict:
        chosen = still(observation)
        chosen["doubt"] = (observation["observation"][:, 0] < 0).float()
        return chosen

    steps = taken(collector_of(Point(), rows=4), UncertaintyGate(policy, unsure_on_the_left, 0.5), 2 * LENGTH)
    on_the_left = steps["observation", "observation"][..., 0] < 0
    assert on_the_left.any()
    assert not on_the_left.all()
    assert torch.equal(steps["source"] == DEMONSTRATOR, on_the_left)


def test_a_cut_truncates_every_episode_and_what_follows_needs_nothing_of_them():
    behaviour = PolicyBehaviour(still)
    one = collector_of(Point())
    one.cut_at = 10
    steps = taken(one, behaviour, 7)
    assert one.cut
    assert steps["next", "truncated"][:, :, 0].tolist() == [[False] * 6 + [True]] * 2
    assert one.finished() == []
    other = collector_of(Point())
    other.restore(one.state())
    assert torch.equal(*(taken(each, behaviour, 30)["observation", "observation"] for each in (one, other)))
    assert one.state() == other.state()


def test_a_round_that_ends_before_is_not_cut():
    collector = collector_of(Point())
    collector.cut_at = 100
    assert not taken(collector, PolicyBehaviour(still), 7)["next", "truncated"].any()
    assert not collector.cut


def test_an_episode_whose_simulation_fails_is_cut_off_and_counts_for_nothing(caplog):
    collector = collector_of(Point(fragile="crash"), rows=1)
    steps = taken(collector, PolicyBehaviour(still), 4 * LENGTH)
    ends = steps["next", "truncated"].flatten().nonzero().flatten().tolist()
    lengths = np.diff([-1, *ends]).tolist()
    assert set(lengths) == {3, LENGTH}
    crashed = [end for end, length in zip(ends, lengths, strict=True) if length == 3]
    assert (~steps["active"][0]).nonzero().flatten().tolist() == crashed, "a crash teaches nothing"
    assert collector.lost_count == lengths.count(3)
    assert [one.length for one in collector.finished()] == [LENGTH] * lengths.count(LENGTH)
    assert "is lost after 2 steps" in caplog.text or "is lost after 3 steps" in caplog.text


@dataclass(frozen=True)
class Doomed(Point):
    """Its simulation never gets far."""

    def make_env(self, rank: int) -> Env:
        return DoomedEnv()


class DoomedEnv(gymnasium.Env[Any, Any]):
    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        return np.zeros(2, np.float32), {}

    def step(self, action: Any) -> Any:
        raise SimulationError("the ground gave way")


def test_a_simulation_of_many_agents_that_fails_is_lost_once():
    collector = collector_of(Point(), rows=2 * MAX_LOST)
    collector.group_size = MAX_LOST
    collector.begin()
    collector._lose(np.arange(2 * MAX_LOST) < MAX_LOST)
    assert collector.lost_count == 1


def test_simulations_that_fail_again_and_again_end_the_run():
    collector = collector_of(Doomed(), rows=1)
    with pytest.raises(SimulationError, match=f"{MAX_LOST} episodes were lost"):
        taken(collector, PolicyBehaviour(still), 100)


@dataclass(frozen=True)
class Ladder(Task):
    """Succeeds at once, up to the level in `succeeds_below`."""

    succeeds_below: int = 2

    name = "ladder"
    observation_space = Box(-1, 10, (1,), np.float32)
    action_space = Box(-1, 1, (1,), np.float32)
    held_out = held_out_seeds(3)
    curriculum = Curriculum(levels=4, threshold=0.75, window=8)

    def make_env(self, rank: int) -> Env:
        return LadderEnv(self.succeeds_below)


class LadderEnv(gymnasium.Env[Any, Any]):
    def __init__(self, below: int) -> None:
        self.below = below

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        self.level = (options or {})["level"]
        return np.array([self.level], np.float32), {}

    def step(self, action: Any) -> Any:
        return np.array([self.level], np.float32), 0.0, True, False, {"success": self.level < self.below}


def test_a_learner_is_promoted_by_its_own_successes():
    collector = collector_of(Ladder(), rows=4)
    levels = taken(collector, PolicyBehaviour(still), 20)["observation", "observation"][..., 0]
    assert levels[0].tolist() == sorted(levels[0].tolist())
    assert collector.level == 2
    assert [one.level for one in collector.finished()].count(0) == 8
    again = collector_of(Ladder(), rows=4)
    again.restore(collector.state())
    assert again.level == 2


@dataclass(frozen=True)
class Halves(Ladder):
    """Half of the episodes succeed at once, the others fail late."""

    curriculum = Curriculum(levels=2, threshold=0.6, window=600)

    def make_env(self, rank: int) -> Env:
        return HalvesEnv()


class HalvesEnv(gymnasium.Env[Any, Any]):
    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        self.succeeds, self.time = np.random.default_rng(seed).random() < 0.5, 0
        return np.zeros(1, np.float32), {}

    def step(self, action: Any) -> Any:
        self.time += 1
        over = self.succeeds or self.time == 6
        return np.zeros(1, np.float32), 0.0, over, False, {"success": self.succeeds}


def test_cuts_promote_nobody_whose_short_episodes_succeed_and_whose_long_ones_fail():
    collector = collector_of(Halves(), rows=16)
    for _ in range(60):
        collector.cut_at = collector.steps + 1
        taken(collector, PolicyBehaviour(still), 9)
        assert collector.cut
    successes = [one.success for one in collector.finished()]
    assert len(successes) > 2000
    assert np.mean(successes) > 0.6, "of those that ended, since cuts fall on long ones"
    assert collector.level == 0


def test_an_episode_counts_when_all_that_began_before_it_are_over():
    progress = Progress(Curriculum(levels=2, threshold=0.6, window=3))
    for row in range(4):
        progress.begin(row)
    for row in (1, 2, 3):
        progress.end(row, success=True)
    assert progress.level == 0, "the first one runs"
    progress.end(0, success=None)
    assert progress.level == 1, "it was lost"


def test_what_runs_at_a_cut_and_what_began_after_it_is_neither_success_nor_failure():
    for late in (True, False):
        progress = Progress(Curriculum(levels=2, threshold=0.6, window=2))
        for row in range(3):
            progress.begin(row)
        progress.end(0, success=True)
        progress.end(2, success=late)
        progress.cut()
        progress.end(1, success=late)
        assert progress.state()["successes"] == [True]


def stands(seen: TensorDict) -> np.ndarray:
    return np.zeros((*seen.batch_size, 1), np.float32)


@pytest.mark.parametrize("rows", [1, 2, 5])
def test_held_out_episodes_are_of_the_last_level_and_as_many_at_once_as_there_are_rows(rows):
    for below in (3, 4):
        task = Ladder(succeeds_below=below)
        found = evaluate(task, task.make_environments(rows, processes=False), stands)
        assert [one.seed for one in found.outcomes] == list(task.held_out)
        assert {one.success for one in found.outcomes} == {below == 4}


def test_a_held_out_episode_that_is_lost_is_in_no_mean(caplog):
    task = Point(fragile="crash")
    found = evaluate(task, task.make_environments(2, processes=False), stands)
    assert 0 < len(found.outcomes) < len(task.held_out)
    assert "is lost, and in no mean" in caplog.text


class Film(gymnasium.Env[Any, Any]):
    """A picture that shows the time; the reward is the action."""

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        self.time = 0
        return self._seen(), {}

    def step(self, action: Any) -> Any:
        self.time += 1
        return self._seen(), float(action[0]), self.time == 7, False, {}

    def _seen(self) -> dict[str, Any]:
        return {"camera": np.full((1, 2, 2), self.time, np.uint8), "speed": np.array([self.time], np.float32)}


def film() -> LocalVectorEnv:
    spaces = Dict({"camera": Box(0, 255, (1, 2, 2), np.uint8), "speed": Box(0, 9, (1,), np.float32)})
    return LocalVectorEnv(lambda rank: Film(), 2, spaces, Box(-1, 1, (1,), np.float32))


def test_stacks_hold_the_last_pictures_and_begin_with_the_first():
    environments = FrameStack(film(), 3)
    check_environments(environments)
    seen, _ = environments.reset(seed=[1, 2])
    assert seen["camera"].shape == (2, 3, 2, 2)
    shown = [seen["camera"][0, :, 0, 0].tolist()]
    for _ in range(3):
        seen, *_ = environments.step(np.ones((2, 1), np.float32))
        shown.append(seen["camera"][0, :, 0, 0].tolist())
    assert shown == [[0, 0, 0], [0, 0, 1], [0, 1, 2], [1, 2, 3]]
    seen, _ = environments.reset(seed=[1, None], options={"reset_mask": np.array([True, False])})
    assert seen["camera"][:, :, 0, 0].tolist() == [[0, 0, 0], [1, 2, 3]]
    environments.reset(seed=[None, 1], options={"reset_mask": np.array([False, True]), "begin_after": 2})
    for _ in range(2):
        seen, *_ = environments.step(np.ones((2, 1), np.float32))
    assert seen["camera"][:, :, 0, 0].tolist() == [[0, 1, 2], [0, 0, 0]]


def test_an_action_is_repeated_until_the_episode_ends():
    environments = ActionRepeat(film(), 4)
    environments.reset(seed=[1, 2])
    seen, reward, *_ = environments.step(np.ones((2, 1), np.float32))
    assert (seen["speed"][0, 0], reward.tolist()) == (4.0, [4.0, 4.0])
    seen, reward, terminated, *_ = environments.step(np.ones((2, 1), np.float32))
    assert (seen["speed"][0, 0], reward.tolist(), terminated.all()) == (7.0, [3.0, 3.0], True)


def test_a_repeated_action_leaves_the_last_observation_of_an_agent_that_ended():
    pair = LocalVectorEnv(Pair, 2, Pair.observation_space, Pair.action_space, measures=("way",), group_size=2)
    environments = ActionRepeat(pair, 3)
    environments.reset(seed=[1, None])
    seen, rewards, terminated, _, infos = environments.step(np.ones((2, 1), np.float32))
    assert seen["observation"][:, 0].tolist() == pytest.approx([1.2, 1.3])
    assert (rewards.tolist(), terminated.tolist()) == ([2.0, 3.0], [True, False])
    assert (infos["_way"].tolist(), infos["way"][0]) == ([True, False], 1.0)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"held_out": range(3)}, "expected held-out seeds in"),
        ({"held_out": ()}, "expected at least one held-out seed"),
        ({"action_space": Box(-np.inf, np.inf, (1,), np.float32)}, "expected actions with finite bounds"),
        ({"observation_space": Box(-1, 1, (2,), np.float64)}, "to be a vector of float32 or a picture"),
        ({"observation_space": Box(-1, 1, (2, 2), np.float32)}, "to be a vector of float32 or a picture"),
        ({"action_space": Box(0, 0, (1,), np.float32)}, "each low one below its high one"),
        ({"observation_space": Dict(parts=Dict(a=Box(-1, 1, (2,))))}, r"picture .* of uint8, got Dict\('a'"),
        ({"observation_space": Dict(action=Box(-1, 1, (2,)))}, "no observation named as a policy's output"),
        ({"action_space": Box(-1, 1, (1, 1), np.float32)}, "expected actions to be a vector of float32 or Discrete"),
    ],
)
def test_a_task_is_checked(changes, message):
    with pytest.raises(InvalidInputError, match=message):
        check_task(type("Changed", (Ladder,), changes)())


def test_learners_reset_environments_themselves():
    made = gymnasium.make_vec("CartPole-v1", num_envs=2)
    with pytest.raises(InvalidInputError, match="expected named observations"):
        check_environments(made)


@pytest.mark.parametrize(
    ("actions", "message"), [((0,), "at least one number in actions"), ((1,), "bounds of at most")]
)
def test_environments_with_boundless_actions_or_none_are_refused(actions, message):
    space = Box(-3e38, 3e38, actions, np.float32)
    made = LocalVectorEnv(Pair, 2, Pair.observation_space, space, measures=(), group_size=2)
    with pytest.raises(InvalidInputError, match=message):
        check_environments(made)


@dataclass(frozen=True)
class Pairs(Task):
    """Two agents of one environment, of which the first ends after two steps, the second after four."""

    name = "pairs"
    observation_space, action_space = Pair.observation_space, Pair.action_space
    held_out: Sequence[int] = held_out_seeds(2)
    measures = ("way",)

    def make_environments(self, count: int, processes: bool) -> Environments:
        spaces = self.observation_space, self.action_space
        return LocalVectorEnv(Pair, 2 * count, *spaces, measures=self.measures, group_size=2)


def pairs(count: int, steps: int) -> tuple[Collector, TensorDict]:
    """Some steps of `count` pairs, whose agents do nothing."""
    collector, behaviour = collector_of(Pairs(), count, seed=5), PolicyBehaviour(still)
    return collector, torch.stack([collector.step(behaviour) for _ in range(steps)], dim=1)


def test_agents_of_one_environment_end_alone_and_begin_together():
    collector, batch = pairs(2, steps=9)
    short, long = [1, 1, 0, 0] * 2 + [1], [1] * 9
    assert batch["active"].int().tolist() == [short, long] * 2
    first, second = [0] * 4 + [2] * 4 + [4], [1] * 4 + [3] * 4 + [5]
    assert batch["episode"].tolist() == [first, first, second, second]
    ends = batch["next", "terminated"][..., 0].nonzero().tolist()
    assert ends == [[row, step + begin] for row, step in ((0, 1), (1, 3), (2, 1), (3, 3)) for begin in (0, 4)]
    finished = collector.finished()
    assert [(one.row, one.length, one.total, one.success) for one in finished] == 2 * [
        (0, 2, 2.0, False),
        (2, 2, 2.0, False),
        (1, 4, 4.0, True),
        (3, 4, 4.0, True),
    ]
    assert collector.steps == int(batch["active"].sum())
    begins = batch["observation", "observation"][:, ::4, 0]
    seeds = [[training_seed(5, number) for number in numbers] for numbers in ([0, 2, 4], [1, 3, 5])]
    assert begins.tolist() == [pytest.approx(of) for of in (seeds[0], seeds[0], seeds[1], seeds[1])]


def test_agents_that_end_at_different_times_are_learned_from_and_judged():
    torch.manual_seed(0)
    task = Pairs()
    collector = Collector(task.make_environments(2, processes=False), task, seed=5)
    config = PpoConfig(horizon=8, hidden=(8,), batch=12, epochs=1, normalised=True)
    ppo = Ppo(task, collector, config, torch.device("cpu"))
    row = ppo.round()
    seeds = [training_seed(5, number) for number in range(4)]
    assert row["reward"] == 1.0
    assert ppo.actor.shift.item() == pytest.approx(np.mean(seeds)), "rows that have ended show 0"
    assert row["episodes"] == 8
    assert row["length"] == 3.0
    assert row["updates"] == 2, "24 of 32 rows acted"
    judged = evaluate(task, task.make_environments(1, processes=False), ppo.act)
    assert [outcome.length for outcome in judged.outcomes] == [2, 4]


def test_a_replay_keeps_what_agents_did_and_nothing_else(tmp_path):
    _, batch = pairs(1, steps=9)
    spaces, config = (named(Pairs.observation_space), Pairs.action_space), ReplayConfig(capacity=100, steps=3)
    replay = Replay(tmp_path, spaces, config, gamma=0.5, slack=9, seed=0)
    for step in batch.unbind(dim=1):
        replay.add(step)
    drawn = replay.sample(400)
    assert len(drawn["index"].unique()) == batch["active"].sum() == 14
    ends, returns = drawn["next", "terminated"][:, 0], drawn["next", "reward"][:, 0]
    assert set(returns[ends].tolist()) == {1.0, 1.5, 1.75}
    assert (drawn["next", "observation", "observation"] > 0).all(), "rows that have ended show 0"
