"""Rows that are reset alone, in this process and in processes of their own: the same numbers, and nothing left."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.error import AlreadyPendingCallError, NoAsyncCallError
from gymnasium.spaces import Box, Dict, Discrete, Tuple
from gymnasium.vector import AutoresetMode

from dohyo.sumo_networks.ego.control import InvalidActionError
from dohyo.sumo_networks.envs.env_rows import EnvError
from dohyo.sumo_networks.envs.local_vector_env import LocalVectorEnv
from dohyo.sumo_networks.envs.process_vector_env import ProcessVectorEnv
from dohyo.sumo_networks.envs.row_vector_env import RowVectorEnv
from dohyo.sumo_networks.errors import InvalidInputError, SimulationError
from tests.sumo_networks.envs.test_vector_env import gone
from tests.sumo_networks.envs.toys import LENGTH, Counter, Pair, Point

ROOT = Path(__file__).parents[3]
KINDS = [LocalVectorEnv, ProcessVectorEnv]
LEFT, RIGHT = 1, 0
"""Seeds of the side where a point begins."""


@contextmanager
def points(kind: type[RowVectorEnv], count: int = 2, fragile: str = "") -> Iterator[RowVectorEnv]:
    env = kind(
        make_env=partial(Point, fragile),
        num_envs=count,
        observation_space=Point.observation_space,
        action_space=Point.action_space,
        measures=("distance",),
        expert=True,
    )
    try:
        yield env
    finally:
        env.close()


def still(env: RowVectorEnv) -> np.ndarray:
    return np.zeros((env.num_envs, 1), np.float32)


def test_the_seeds_say_where_a_point_begins() -> None:
    assert [Point().reset(seed=seed)[0][0] for seed in (LEFT, RIGHT)] == [-1.0, 1.0]


def flat(results: Any) -> list[np.ndarray]:
    if isinstance(results, dict):
        return [array for name in sorted(results) for array in flat(results[name])]
    return [array for one in results for array in flat(one)] if isinstance(results, tuple) else [results]


def test_both_kinds_give_the_same_numbers() -> None:
    runs = []
    for kind in KINDS:
        rng = np.random.default_rng(5)
        with points(kind, 3) as env:
            seen = flat(env.reset(seed=[1, 2, 3]))
            for number in range(60):
                step = env.step(rng.uniform(-0.25, 0.25, (3, 1)))
                seen += flat(step) + flat(env.expert_actions(rng.random(3) < 0.5)[1])
                ended = step[2] | step[3]
                if ended.any():
                    seen += flat(env.reset(seed=[number] * 3, options={"reset_mask": ended, "level": number % 3}))
        runs.append(seen)
    assert len(runs[0]) == len(runs[1])
    assert all(np.array_equal(one, other) for one, other in zip(*runs, strict=True))


@pytest.mark.parametrize("kind", KINDS)
def test_an_episode_ends_with_its_last_observation_and_its_measures(kind: type[RowVectorEnv]) -> None:
    with points(kind) as env:
        assert env.metadata["autoreset_mode"] is AutoresetMode.DISABLED
        assert env.single_observation_space == Dict({"observation": Point.observation_space})
        env.reset(seed=[LEFT, RIGHT], options={"level": 1})
        env.reset(seed=[None, LEFT], options={"reset_mask": np.array([False, True])})
        for _ in range(LENGTH - 1):
            *_, truncated, infos = env.step(still(env))
            assert not truncated.any()
            assert "success" not in infos
        observations, rewards, terminated, truncated, infos = env.step(np.float32([[0.0], [0.25]]))
        assert observations["observation"].tolist() == [[-1.0, LENGTH], [-0.75, LENGTH]]
        assert rewards.tolist() == [-1.0, -0.75]
        assert (terminated.tolist(), truncated.tolist()) == ([False, False], [False, True])
        assert infos["_distance"].tolist() == infos["_success"].tolist() == [False, True]
        assert (infos["distance"][1], infos["success"][1]) == (-0.75, False)
        # The row that has ended keeps its observation, and gets no reward.
        observations, rewards, _, truncated, infos = env.step(np.float32([[0.25], [0.25]]))
        assert observations["observation"].tolist() == [[-0.75, LENGTH + 1], [-0.75, LENGTH]]
        assert rewards.tolist() == [-0.75, 0.0]
        assert truncated.tolist() == infos["active"].tolist() == [True, False]
        fresh, infos = env.reset(seed=[None, RIGHT], options={"reset_mask": np.array([False, True])})
        assert fresh["observation"].tolist() == [[-0.75, LENGTH + 1], [1.0, 0.0]]
        assert infos["lost"].tolist() == [False, False]


def test_both_kinds_begin_episodes_later_in_the_same_steps() -> None:
    runs = []
    for kind in KINDS:
        with points(kind, 3) as env:
            seen = flat(env.reset(seed=[1, 2, 3], options={"level": 0}))
            env.reset(seed=[0, 0, 0], options={"reset_mask": np.array([False, True, True]), "level": 7})
            for number in range(80):
                step = env.step(np.full((3, 1), 0.01 * number % 0.25, np.float32))
                seen += flat(step)
                if (ended := step[2] | step[3]).any():
                    later = {"reset_mask": ended, "begin_after": 4, "level": number % 3}
                    seen += flat(env.reset(seed=[number] * 3, options=later))
        runs.append(seen)
    assert len(runs[0]) == len(runs[1])
    assert all(np.array_equal(one, other) for one, other in zip(*runs, strict=True))


@pytest.mark.parametrize("kind", KINDS)
def test_a_row_begins_later_while_another_one_drives(kind: type[RowVectorEnv]) -> None:
    later = {"begin_after": 2, "reset_mask": np.array([False, True])}
    with points(kind) as env:
        env.reset(seed=[LEFT, LEFT])
        observations, infos = env.reset(seed=[None, RIGHT], options=later)
        assert observations["observation"].tolist() == [[-1.0, 0.0], [0.0, 0.0]]
        assert infos["begun"].tolist() == [False, False]
        told = []
        for _ in range(3):
            observations, *_, infos = env.step(still(env))
            begun = infos.get("begun", np.zeros(2, np.bool_))
            told.append((infos["active"].tolist(), begun.tolist(), observations["observation"][1].tolist()))
        assert told == [
            ([True, False], [False, False], [0.0, 0.0]),
            ([True, False], [False, True], [1.0, 0.0]),
            ([True, True], [False, False], [1.0, 1.0]),
        ]
        # A row that sits out may be reset again, and nothing of the first reset is left.
        env.reset(seed=[None, RIGHT], options=later)
        observations, infos = env.reset(seed=[None, LEFT], options={"reset_mask": later["reset_mask"]})
        assert observations["observation"][1].tolist() == [-1.0, 0.0]
        assert infos["begun"].tolist() == [False, True]
        # Pictures do not change when it begins.
        env.reset(seed=[None, RIGHT], options=later)
        env.render()
        assert not env.step(still(env))[4]["begun"].any()
        observations, *_, infos = env.step(still(env))
        assert (observations["observation"][1].tolist(), infos["begun"].tolist()) == ([1.0, 0.0], [False, True])


@pytest.mark.parametrize("kind", KINDS)
def test_where_no_row_drives_all_begin_at_once(kind: type[RowVectorEnv]) -> None:
    with points(kind) as env:
        observations, infos = env.reset(seed=[LEFT, RIGHT], options={"begin_after": 9})
        assert (observations["observation"][:, 0].tolist(), infos["begun"].tolist()) == ([-1.0, 1.0], [True, True])
        for _ in range(LENGTH - 1):
            env.step(still(env))
        env.reset(seed=[LEFT, LEFT], options={"begin_after": 9, "reset_mask": np.array([False, True])})
        *_, truncated, infos = env.step(still(env))
        assert (truncated.tolist(), infos["begun"].tolist()) == ([True, False], [False, True])


@pytest.mark.parametrize("kind", KINDS)
def test_a_reset_that_fails_later_is_lost_in_its_turn(kind: type[RowVectorEnv]) -> None:
    with points(kind, fragile="crash-at-reset") as env:
        env.reset(seed=[LEFT, LEFT])
        env.reset(seed=[None, RIGHT], options={"begin_after": 2, "reset_mask": np.array([False, True])})
        told = [env.step(still(env))[4] for _ in range(3)]
        assert [infos["lost"].tolist() for infos in told] == [[False, False], [False, True], [False, False]]
        assert not any(infos.get("begun", np.zeros(2)).any() for infos in told)
        _, infos = env.reset(seed=[None, LEFT], options={"reset_mask": np.array([False, True])})
        assert infos["begun"].tolist() == [False, True]


@pytest.mark.parametrize("kind", KINDS)
def test_pictures_and_discrete_actions(kind: type[RowVectorEnv]) -> None:
    env = kind(Counter, 2, Counter.observation_space, Counter.action_space)
    first, _ = env.reset(seed=[3, 8])
    assert env.observation_space.contains(first)
    observations, _, terminated, _, _ = env.step(np.array([1, 2]))
    env.close()
    assert first["picture"][:, 0, 0, 0].tolist() == [3, 8]
    assert observations["picture"][:, 0, 0, 0].tolist() == [4, 10]
    assert terminated.tolist() == [False, True]
    assert observations["vector"][:, 0].tolist() == [0.0, 1.0]
    if kind is ProcessVectorEnv:  # one thread each, in process groups of their own
        assert observations["vector"][:, 1:].tolist() == [[1.0, 1.0], [1.0, 1.0]]


@pytest.mark.parametrize("kind", KINDS)
def test_agents_of_one_environment_are_rows_that_end_alone(kind: type[RowVectorEnv]) -> None:
    env = kind(Pair, 4, Pair.observation_space, Pair.action_space, measures=("way",), group_size=2)
    first, _ = env.reset(seed=[10, None, 20, None])
    assert first["observation"][:, 0].tolist() == [10.0, 10.0, 20.0, 20.0]
    actions = np.float32([[0.1], [0.2], [0.3], [0.4]])
    active, ends, ways = [], [], []
    for _ in range(5):
        observations, rewards, terminated, _, infos = env.step(actions)
        assert rewards.tolist() == infos["active"].astype(float).tolist()
        assert (observations["observation"][:, 0] > 0).tolist() == infos["active"].tolist()
        active.append(infos["active"].tolist())
        ends.append(terminated.tolist())
        ways.append(np.where(infos.get("_way", False), infos.get("way", 0.0), 0.0).round(3).tolist())
    again, _ = env.reset(seed=[1, 1, 30, 1], options={"reset_mask": np.array([False, False, True, True])})
    env.close()
    short, both = [False, True] * 2, [True] * 4
    assert active == [both, both, short, short, [False] * 4]
    assert ends == [[False] * 4, [True, False] * 2, [False] * 4, short, [False] * 4]
    assert ways[1] == [0.1, 0.0, 0.3, 0.0]
    assert ways[3] == [0.0, 0.2, 0.0, 0.4]
    assert again["observation"][2:, 0].tolist() == [30.0, 30.0]


@pytest.mark.parametrize(
    ("breach", "message"),
    [
        ("late", "environment 0: expected all agents to begin the episode, ['long'] did not"),
        ("lost", "environment 0: agent 'short' has left, but its episode neither terminated nor was truncated"),
    ],
)
def test_agents_that_come_late_or_leave_without_an_end_are_named(breach: str, message: str) -> None:
    env = LocalVectorEnv(partial(Pair, breach=breach), 2, Pair.observation_space, Pair.action_space, group_size=2)
    with pytest.raises(EnvError, match=re.escape(message)):  # noqa: PT012 - at the reset or at the step
        env.reset(seed=[1, None])
        env.step(still(env))


def test_an_agent_that_stays_after_its_end_gets_nothing() -> None:
    env = LocalVectorEnv(partial(Pair, breach="stays"), 2, Pair.observation_space, Pair.action_space, group_size=2)
    env.reset(seed=[1, None])
    steps = [env.step(still(env)) for _ in range(4)]
    assert [rewards.tolist() for _, rewards, *_ in steps] == [[1.0, 1.0]] * 2 + [[0.0, 1.0]] * 2
    assert [ends.tolist() for _, _, ends, *_ in steps][2:] == [[False, False], [False, True]]


@pytest.mark.parametrize("kind", KINDS)
def test_an_environment_that_cannot_be_closed_stops_nobody(kind: type[RowVectorEnv]) -> None:
    with points(kind, fragile="close") as env:
        env.reset(seed=[LEFT, RIGHT])


@pytest.mark.parametrize("kind", KINDS)
def test_the_expert_is_asked_and_does_not_drive(kind: type[RowVectorEnv]) -> None:
    with points(kind) as env:
        env.reset(seed=[LEFT, RIGHT])
        actions, known = env.expert_actions(np.array([True, False]))
        assert known.tolist() == [True, False]
        assert actions[0].tolist() == [0.25]
        for _ in range(11):
            before = env.expert_actions(np.array([True, True]))[1]
            observations = env.step(still(env))[0]
        assert before.all()
        assert observations["observation"][:, 0].tolist() == [-1.0, 1.0]
        assert not env.expert_actions(np.array([True, True]))[1].any()
    without = kind(Counter, 1, Counter.observation_space, Counter.action_space)
    with pytest.raises(InvalidInputError, match="no expert"):
        without.expert_actions(np.array([True]))
    without.close()


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    ("fragile", "message"),
    [
        ("nan", "environment 0: expected finite observations, got others in 'observation' at [[0]]"),
        ("shape", "environment 0: observation 'observation': expected shape (2,), got (1, 2)"),
        ("dtype", "environment 0: observation 'observation': expected float32, got complex64"),
        ("reward", "environment 0: expected as reward one finite number, of 3e+38 at most, got inf"),
        ("rewards", "environment 0: expected as reward one finite number, of 3e+38 at most, got [0. 0.]"),
        ("word", "environment 0: expected as reward one finite number, of 3e+38 at most, got 1"),
        ("success", "environment 0: expected as success true, false, 0 or 1, got 'no'"),
        ("measure", "environment 0: the last info of an episode lacks distance"),
        ("raise", "environment 0: ValueError: the point is lost"),
    ],
)
def test_code_that_fails_is_named(
    kind: type[RowVectorEnv], fragile: str, message: str, caplog: pytest.LogCaptureFixture
) -> None:
    with points(kind, fragile=fragile) as env:
        env.reset(seed=[LEFT, LEFT])
        for _ in range(LENGTH - 1 if fragile in ("measure", "success") else 0):
            env.step(still(env))
        with pytest.raises(EnvError, match=re.escape(message)):
            env.step(still(env))
    where = "in step" if fragile == "raise" else "in _"
    assert where in caplog.text, "the log has the traceback of the environment's process"


@pytest.mark.parametrize("kind", KINDS)
def test_a_reward_may_be_an_array_of_one_number(kind: type[RowVectorEnv]) -> None:
    with points(kind, fragile="boxed") as env:
        env.reset(seed=[LEFT, RIGHT])
        assert env.step(np.full((2, 1), 0.25, np.float32))[1].tolist() == [-0.75, -1.25]


class Ending(gymnasium.Env[Any, Any]):
    """Ends in its first step, with a success of any kind."""

    observation_space = Box(-1.0, 1.0, (1,), np.float32)
    action_space = Discrete(2)

    def __init__(self, info: dict[str, Any], rank: int) -> None:
        self.info = info

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        return np.zeros(1, np.float32), {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        return np.zeros(1, np.float32), 0.0, True, False, self.info


def succeeded(info: dict[str, Any]) -> bool:
    """What an environment with such a last info reports."""
    env = LocalVectorEnv(partial(Ending, info), 1, Ending.observation_space, Ending.action_space)
    env.reset(seed=[0])
    return bool(env.step(np.zeros(1, np.int64))[4]["success"][0])


def test_success_is_a_truth_value_or_0_or_1() -> None:
    for yes in (True, np.True_, 1, 1.0, np.float32(1.0), np.array(True), np.array([1])):
        assert succeeded({"success": yes})
    for no in (False, np.False_, 0, 0.0, np.int64(0), np.array([False])):
        assert not succeeded({"success": no})
    assert not succeeded({})
    for odd in ("no", "", "1", 0.5, 2, -1, np.nan, None, [True, False], [[1], [1, 0]], np.ones(2), {}):
        with pytest.raises(EnvError, match="expected as success true, false, 0 or 1, got"):
            succeeded({"success": odd})


@pytest.mark.parametrize(("kind", "fragile"), [*product(KINDS, ("crash", "die"))])
def test_an_episode_whose_simulation_fails_is_lost_alone(
    kind: type[RowVectorEnv], fragile: str, caplog: pytest.LogCaptureFixture
) -> None:
    with points(kind, fragile=fragile) as env:
        env.reset(seed=[RIGHT, LEFT])
        for _ in range(2):
            before, *_, infos = env.step(np.full((2, 1), 0.1, np.float32))
            assert not infos["lost"].any()
        after, rewards, terminated, truncated, infos = env.step(np.full((2, 1), 0.1, np.float32))
        assert after["observation"][0].tolist() == before["observation"][0].tolist()
        assert (rewards[0], terminated.any(), truncated.tolist()) == (0.0, False, [True, False])
        assert infos["lost"].tolist() == [True, False]
        assert "success" not in infos
        reason = "the point fell off the line" if fragile == "crash" else r"end(ed)?( the process)? with code 3"
        assert re.search(reason, caplog.text)
        assert re.search(reason, str(env.failures[0]))
        fresh, infos = env.reset(seed=[LEFT, None], options={"reset_mask": np.array([True, False])})
        assert fresh["observation"][0].tolist() == [-1.0, 0.0]
        assert fresh["observation"][1, 1] == 3.0
        assert not infos["lost"].any()
        for _ in range(LENGTH):
            *_, truncated, infos = env.step(still(env))
        assert infos["_distance"].tolist() == truncated.tolist() == [True, False]


@pytest.mark.parametrize("kind", KINDS)
def test_a_reset_that_fails_is_reported(kind: type[RowVectorEnv]) -> None:
    with points(kind, fragile="crash-at-reset") as env:
        assert env.reset(seed=[LEFT, RIGHT])[1]["lost"].tolist() == [False, True]
        assert env.step(still(env))[4]["active"].tolist() == [True, False]
        infos = env.reset(seed=[None, LEFT], options={"reset_mask": np.array([False, True])})[1]
        assert not infos["lost"].any()
        assert env.step(still(env))[4]["active"].all()


def test_a_process_that_died_between_two_steps_is_lost_at_the_next() -> None:
    with points(ProcessVectorEnv) as env:
        assert isinstance(env, ProcessVectorEnv)
        env.reset(seed=[LEFT, LEFT])
        os.kill(env.pids[1], signal.SIGKILL)
        assert env.expert_actions(np.array([True, True]))[1].tolist() == [True, False]
        assert env.step(still(env))[4]["lost"].tolist() == [False, True]
        assert not env.reset(seed=[LEFT, LEFT])[1]["lost"].any()
        pids = env.pids
    assert gone(pids)


@pytest.mark.parametrize("kind", KINDS)
def test_a_step_may_be_waited_for_later(kind: type[RowVectorEnv]) -> None:
    with points(kind) as env:
        env.reset(seed=[LEFT, LEFT])
        with pytest.raises(NoAsyncCallError):
            env.step_wait()
        env.step_async(still(env))
        for call in (env.reset, lambda: env.step_async(still(env)), lambda: env.expert_actions(np.ones(2, bool))):
            with pytest.raises(AlreadyPendingCallError):
                call()
        assert env.step_wait()[0]["observation"][:, 1].tolist() == [1.0, 1.0]


@pytest.mark.parametrize("kind", KINDS)
def test_results_belong_to_the_caller(kind: type[RowVectorEnv]) -> None:
    with points(kind) as env:
        first, _ = env.reset(seed=[LEFT, RIGHT])
        second = env.step(np.full((2, 1), 0.1, np.float32))
        kept = [array.copy() for array in flat(second)]
        env.step(still(env))
        assert first["observation"][:, 1].tolist() == [0.0, 0.0]
        assert all(np.array_equal(one, other) for one, other in zip(kept, flat(second), strict=True))


@pytest.mark.parametrize("kind", KINDS)
def test_wrong_arguments_move_nothing(kind: type[RowVectorEnv]) -> None:
    with points(kind) as env:
        env.reset(seed=[LEFT, LEFT])
        wrong: list[tuple[type[Exception], Callable[[], Any]]] = [
            (InvalidActionError, lambda: env.step(np.zeros((2, 2)))),
            (InvalidActionError, lambda: env.step(np.full((2, 1), np.nan))),
            (InvalidActionError, lambda: env.step("left")),
            (InvalidInputError, lambda: env.reset(seed=[1])),
            (InvalidInputError, lambda: env.reset(options={"reset_mask": np.ones(3, bool)})),
        ]
        for error, call in wrong:
            with pytest.raises(error, match="expected"):
                call()
        assert env.step(still(env))[0]["observation"][:, 1].tolist() == [1.0, 1.0]
    with pytest.raises(SimulationError, match="closed"):
        env.step(still(env))


@pytest.mark.parametrize("kind", KINDS)
def test_frames_come_from_every_environment(kind: type[RowVectorEnv]) -> None:
    with points(kind) as env:
        with pytest.raises(SimulationError, match="environment 0 has not been reset"):
            env.render()
        env.reset(seed=[LEFT, LEFT])
        env.step(still(env))
        frames = env.render()
        assert frames is not None
        assert [frame.tolist() for frame in frames] == [np.ones((2, 2, 3)).tolist()] * 2


@pytest.mark.parametrize(
    ("changed", "says"),
    [
        ({"num_envs": 0}, "at least one environment"),
        ({"num_envs": 3, "group_size": 2}, "2 rows, got num_envs=3"),
        ({"observation_space": Box(-1, 1, (2,), np.float64)}, "float32 or uint8"),
        ({"observation_space": Dict({"a": Dict({"b": Box(-1, 1)})})}, "'a': expected a Box"),
        ({"action_space": Tuple([])}, "Box or Discrete"),
        ({"make_env": lambda rank: Point()}, "cannot be sent to another process"),
    ],
)
def test_impossible_environments_are_refused(changed: dict[str, Any], says: str) -> None:
    arguments = {
        "make_env": Counter,
        "num_envs": 1,
        "observation_space": Counter.observation_space,
        "action_space": Counter.action_space,
    }
    with pytest.raises(InvalidInputError, match=says):
        ProcessVectorEnv(**{**arguments, **changed})


@pytest.mark.parametrize("module", ["process_vector_env", "local_vector_env", "vector_env"])
def test_a_worker_does_not_load_torch(module: str) -> None:
    code = f"import sys, dohyo.sumo_networks.envs.{module}; assert 'torch' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=True)


def test_wrappers_keep_the_expert() -> None:
    env = LocalVectorEnv(
        lambda rank: gymnasium.wrappers.TimeLimit(Point(), 3),
        1,
        Point.observation_space,
        Point.action_space,
        expert=True,
    )
    env.reset(seed=[LEFT])
    assert env.expert_actions(np.ones(1, bool))[1].tolist() == [True]
    env.close()
