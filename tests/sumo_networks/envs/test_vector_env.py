"""Vectorised environments: the same numbers as one environment alone, and nothing left behind."""

from __future__ import annotations

import gc
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers.vector import RecordEpisodeStatistics

from dohyo.sumo_networks.ego.control import InvalidActionError
from dohyo.sumo_networks.envs.driving_env import DrivingEnv
from dohyo.sumo_networks.envs.scenario_env import scenario_rows
from dohyo.sumo_networks.envs.vector_env import VectorDrivingEnv
from dohyo.sumo_networks.errors import InvalidInputError, SimulationError, UnknownNameError
from dohyo.sumo_networks.scenario import Mission, Place, Scenario, Traffic
from dohyo.sumo_networks.seeds import training_seed

ROOT = Path(__file__).parents[3]


def scenario(*starts_m: float, limit_s: float = 1.0, vehicles: int = 15, goal_m: float = 40.0) -> Scenario:
    """Egos one behind the other on a street of Ingolstadt."""
    return Scenario(
        network="ingolstadt",
        missions=tuple(
            Mission(
                name=f"ego-{i}",
                start=Place(lane="737320747#3_2", position_m=start),
                goal=Place(lane="737320747#4_2", position_m=goal_m),
            )
            for i, start in enumerate(starts_m)
        ),
        traffic=Traffic(vehicles=vehicles, pedestrians=5, warm_up_s=3.0),
        time_limit_s=limit_s,
    )


SCENARIOS = (scenario(5.0), scenario(20.0, limit_s=0.7), scenario(12.0, vehicles=4, limit_s=1.3))


def numbered(episode: int) -> Scenario:
    return SCENARIOS[episode % len(SCENARIOS)]


def broken_second(episode: int) -> Scenario:
    if episode == 1:
        return SCENARIOS[0].model_copy(update={"network": "ingolstat"})
    return SCENARIOS[0]


def actions(env: VectorDrivingEnv, steps: int) -> Iterator[np.ndarray]:
    rng = np.random.default_rng(3)
    shape = env.action_space.shape
    assert shape is not None
    for _ in range(steps):
        yield rng.uniform([0.0, -0.1], [12.0, 0.1], size=shape).astype(np.float32)


class Alone:
    """The episodes of one environment of many, driven by plain DrivingEnvs in this process."""

    def __init__(self, index: int, envs: int, seed: int) -> None:
        self.episode, self.envs, self.seed = index, envs, seed
        self.env: DrivingEnv | None = None
        self.observation = self.begin()

    def begin(self) -> dict[str, np.ndarray]:
        if self.env is not None:
            self.env.close()
        self.env = DrivingEnv(numbered(self.episode))
        observations, _ = self.env.reset(seed=training_seed(self.seed, self.episode))
        return observations["ego-0"]

    def step(self, action: np.ndarray) -> tuple[float, bool, bool, dict[str, np.ndarray] | None]:
        assert self.env is not None
        observations, rewards, terminations, truncations, _ = self.env.step({"ego-0": action})
        final = None
        self.observation = observations["ego-0"]
        if not self.env.agents:
            final = self.observation
            self.episode += self.envs
            self.observation = self.begin()
        return rewards["ego-0"], terminations["ego-0"], truncations["ego-0"], final


@pytest.mark.parametrize(("envs", "source"), [(3, SCENARIOS), (1, numbered)])
def test_each_environment_gives_what_it_would_give_alone(envs: int, source: Any) -> None:
    vector = VectorDrivingEnv(source, envs)
    first, _ = vector.reset(seed=11)
    plan = list(actions(vector, 25))
    steps = [vector.step(action) for action in plan]
    vector.close()

    episodes = 0
    for w in range(envs):
        alone = Alone(w, envs, seed=11)
        for sensor, value in alone.observation.items():
            np.testing.assert_array_equal(first[sensor][w], value)
        for action, (observations, rewards, terminations, truncations, infos) in zip(plan, steps, strict=True):
            reward, terminated, truncated, final = alone.step(action[w])
            assert (rewards[w], terminations[w], truncations[w]) == (reward, terminated, truncated)
            assert infos["episode_number"][w] == alone.episode
            assert (final is not None) == bool(infos.get("_final_obs", np.zeros(envs))[w])
            for sensor, value in alone.observation.items():
                np.testing.assert_array_equal(observations[sensor][w], value)
            for sensor, value in (final or {}).items():
                np.testing.assert_array_equal(infos["final_obs"][w][sensor], value)
            episodes += final is not None
        assert alone.env is not None
        alone.env.close()
    assert episodes >= 2 * envs


@pytest.fixture(scope="module")
def pair() -> Iterator[VectorDrivingEnv]:
    env = VectorDrivingEnv(SCENARIOS, 2)
    yield env
    env.close()


def drive(env: VectorDrivingEnv, seed: int | None, steps: int = 15) -> list[np.ndarray]:
    observations, _ = env.reset(seed=seed)
    seen = list(observations.values())
    for action in actions(env, steps):
        observations, *rest, infos = env.step(action)
        seen += [*observations.values(), *rest, infos["episode_number"]]
    return seen


def equal(a: list[np.ndarray], b: list[np.ndarray]) -> bool:
    return all(np.array_equal(one, other) for one, other in zip(a, b, strict=True))


def test_the_same_seed_repeats_the_run_and_another_does_not(pair: VectorDrivingEnv) -> None:
    first = drive(pair, 4)
    other = drive(pair, 5)
    goes_on = drive(pair, None)
    again = drive(pair, 4)
    assert equal(first, again)
    assert not equal(first, other)
    assert not equal(other, goes_on)


def test_arrays_fit_the_spaces_and_belong_to_the_caller(pair: VectorDrivingEnv) -> None:
    first, _ = pair.reset(seed=1)
    assert set(first) == set(pair.single_observation_space.keys())  # type: ignore[attr-defined]
    assert all(array.dtype == np.float32 and array.shape[0] == 2 for array in first.values())
    before = {name: array.copy() for name, array in first.items()}
    pair.step(np.full((2, 2), 5.0, np.float32))
    assert all(np.array_equal(first[name], before[name]) for name in first)


@pytest.mark.parametrize(
    ("action", "says"),
    [
        (np.zeros((2, 3)), r"shape \(2, 2\), got shape \(2, 3\)"),
        (np.full((2, 2), np.nan), "finite"),
        (np.full((2, 2), 1j), "expected real numbers"),
        ("left", "shape"),
        ([[5.0], [5.0, 0.0]], r"expected an array of shape \(2, 2\), got \[\[5.0\], \[5.0, 0.0\]\]"),
        ([[5.0, 0.0], [10**400, 0.0]], r"expected an array of shape \(2, 2\)"),
        (np.full((2, 2), np.inf), "expected finite actions"),
    ],
)
def test_a_bad_action_moves_nothing(pair: VectorDrivingEnv, action: Any, says: str) -> None:
    good = np.full((2, 2), 5.0, np.float32) * [1.0, 0.0]
    pair.reset(seed=1)
    expected = pair.step(good)[0]
    pair.reset(seed=1)
    with pytest.raises(InvalidActionError, match=says):
        pair.step(action)
    observations = pair.step(good)[0]
    assert all(np.array_equal(observations[name], expected[name]) for name in expected)


@pytest.mark.filterwarnings("error")
def test_numbers_too_large_for_an_action_are_clipped_as_others_out_of_bounds(pair: VectorDrivingEnv) -> None:
    seen = []
    for action in (np.full((2, 2), 1e39), np.full((2, 2), 100, np.int64), np.full((2, 2), 100.0, np.float32)):
        pair.reset(seed=1)
        seen.append(pair.step(action)[0])
    for name in seen[0]:
        assert np.array_equal(seen[0][name], seen[1][name])
        assert np.array_equal(seen[0][name], seen[2][name])


def near_and_far() -> Scenario:
    """The first ego stands 2 m before its goal; the second is later than its limit of 2 s first."""
    near, far = scenario(30.0, goal_m=-1.0).missions[0], scenario(5.0, 5.0).missions[1]
    near = near.model_copy(update={"goal": Place(lane="737320747#3_2", position_m=33.0)})
    return SCENARIOS[0].model_copy(update={"missions": (near, far), "time_limit_s": 2.0})


def test_an_ego_whose_episode_has_ended_is_masked_until_all_have() -> None:
    env = VectorDrivingEnv([near_and_far()], 1, reward="progress")
    assert env.action_space.shape == (1, 2, 2)
    observations, infos = env.reset(seed=0)
    assert observations["route"].shape == (1, 2, 80, 7)
    history = []
    for _ in range(21):
        observations, rewards, terminations, truncations, infos = env.step(np.full((1, 2, 2), [3.0, 0.0], np.float32))
        history.append((terminations[0].tolist(), truncations[0].tolist(), infos["active"][0].tolist()))
        if not infos["active"][0, 0]:
            assert rewards[0, 0] == 0.0
            if "final_obs" not in infos:
                assert not any(array[0, 0].any() for array in observations.values())
                assert observations["route"][0, 1].any()
    env.close()
    arrival = next(i for i, (terminations, _, _) in enumerate(history) if terminations[0])
    assert history[arrival] == ([True, False], [False, False], [True, True])
    assert all(step == ([False, False], [False, False], [False, True]) for step in history[arrival + 1 : -1])
    assert history[-1] == ([False, False], [False, True], [False, True])
    assert infos["_final_obs"].tolist() == [True]
    assert infos["episode_number"].tolist() == [1]


def test_the_next_step_may_start_the_next_episode() -> None:
    same, following = (VectorDrivingEnv(SCENARIOS, 1, autoreset_mode=mode) for mode in list(AutoresetMode)[1::-1])
    assert (same.autoreset_mode, following.autoreset_mode) == (AutoresetMode.SAME_STEP, AutoresetMode.NEXT_STEP)
    same.reset(seed=2)
    following.reset(seed=2)
    go = np.float32([[6.0, 0.0]])
    for _ in range(10):
        np.testing.assert_equal(following.step(go)[:4], same.step(go)[:4])
    fresh, reward, _, truncated, infos = same.step(go)
    last, its_reward, _, its_truncated, _ = following.step(go)
    assert truncated.tolist() == its_truncated.tolist() == [True]
    assert reward == its_reward
    np.testing.assert_equal({name: array[0] for name, array in last.items()}, infos["final_obs"][0])
    begun, nothing, terminated, truncated, infos = following.step(go)
    np.testing.assert_equal(begun, fresh)
    assert (nothing[0], terminated[0], truncated[0], infos["episode_number"][0]) == (0.0, False, False, 1)
    assert infos["active"].tolist() == [False], "nobody drove in this tick"
    same.close()
    following.close()


def near_or_far(episode: int) -> Scenario:
    """With one ego: the even episodes reach their goal, the odd ones their limit of 2 s."""
    both = near_and_far()
    return both.model_copy(update={"missions": both.missions[episode % 2 :][:1]})


@pytest.mark.parametrize("mode", list(AutoresetMode))
def test_the_end_of_an_episode_says_whether_it_succeeded(mode: AutoresetMode) -> None:
    env = VectorDrivingEnv(near_or_far, 2, sensors=("speedometer",), reward=None, autoreset_mode=mode)
    env.reset(seed=0)
    found: dict[int, list[bool]] = {0: [], 1: []}
    for _ in range(21):
        *_, terminations, truncations, infos = env.step(np.full((2, 2), [3.0, 0.0], np.float32))
        ended = terminations | truncations
        assert infos.get("_success", np.zeros(2, np.bool_)).tolist() == ended.tolist()
        for w in np.flatnonzero(ended):
            found[w].append(bool(infos["success"][w]))
        if mode is AutoresetMode.SAME_STEP and ended.any():
            final = infos["final_info"]
            assert infos["_final_info"].tolist() == final["_success"].tolist() == ended.tolist()
            assert final["success"].tolist() == infos["success"].tolist()
            assert (infos["episode_number"] - final["episode_number"]).tolist() == (2 * ended).tolist()
    env.close()
    assert found[0][0] is True
    assert found[1] == [False]


def test_every_ego_has_its_own_success() -> None:
    env = VectorDrivingEnv([near_and_far()], 1, sensors=("speedometer",), reward=None)
    env.reset(seed=0)
    ends = []
    for _ in range(21):
        infos = env.step(np.full((1, 2, 2), [3.0, 0.0], np.float32))[4]
        if "success" in infos:
            ends.append((infos["success"].tolist(), infos["_success"].tolist(), "final_info" in infos))
    env.close()
    assert ends == [([[True, False]], [[True, False]], False), ([[False, False]], [[False, True]], True)]


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
def test_gymnasiums_statistics_of_episodes_are_of_ours(mode: AutoresetMode) -> None:
    made = VectorDrivingEnv((scenario(5.0, limit_s=0.25),), 2, sensors=("speedometer",), autoreset_mode=mode)
    env = RecordEpisodeStatistics(made)
    env.reset(seed=0)
    for _ in range(3):
        *_, infos = env.step(np.zeros((2, 2), np.float32))
    env.close()
    assert infos["episode"]["l"].tolist() == [3, 3]


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"seed": -3}, "a whole number of at least 0, got -3"),
        ({"seed": 1.5}, "a whole number of at least 0, got 1.5"),
        ({"seed": [-3, 1]}, "a whole number of at least 0, got -3"),
        ({"seed": [1, "2"]}, "a whole number of at least 0, got '2'"),
        ({"seed": [1, 2**31]}, "a whole number from 0 to 2147483647, got 2147483648"),
        ({"seed": [1]}, "expected 2 seeds, got 1"),
        ({"options": {"reset_mask": np.array([True])}}, r"a mask of shape \(2,\), got \(1,\)"),
        ({"options": {"reset_mask": [[True], [True, False]]}}, r"a mask of shape \(2,\), got \[\[True\]"),
        ({"seed": 9, "options": {"reset_mask": np.array([True])}}, "a mask of shape"),
    ],
)
def test_a_reset_that_is_refused_changes_nothing(pair: VectorDrivingEnv, options: dict[str, Any], says: str) -> None:
    pair.reset(seed=4)
    expected = pair.reset()
    pair.reset(seed=4)
    with pytest.raises(InvalidInputError, match=says):
        pair.reset(**options)
    np.testing.assert_equal(pair.reset(), expected)


def test_frames_come_from_every_environment() -> None:
    env = VectorDrivingEnv(SCENARIOS, 2, render_mode="rgb_array")
    with pytest.raises(SimulationError, match="has not been reset"):
        env.render()
    env.reset(seed=0)
    first = env.render()
    assert first is not None
    env.step(np.tile(np.float32([12.0, 0.0]), (2, 1)))
    assert [frame.shape for frame in first] == [(480, 480, 3)] * 2
    assert not np.array_equal(first[0], first[1])
    env.close()


def test_without_autoreset_the_caller_says_who_is_reset() -> None:
    env = VectorDrivingEnv(
        (scenario(5.0, limit_s=0.25), scenario(5.0, limit_s=9.0)), 2, autoreset_mode=AutoresetMode.DISABLED
    )
    env.reset(seed=0)
    for _ in range(3):
        _, _, _, truncations, infos = env.step(np.tile(np.float32([6.0, 0.0]), (2, 1)))
    assert truncations.tolist() == [True, False]
    idle = env.step(np.zeros((2, 2), np.float32))
    assert idle[4]["active"].tolist() == [False, True]
    before = idle[0]
    after, infos = env.reset(options={"reset_mask": np.array([True, False])})
    assert infos["episode_number"].tolist() == [2, 1]
    assert after["speedometer"][0, 0] == 0.0
    assert np.array_equal(before["objects"][1], after["objects"][1])
    env.close()


def test_an_environment_alone_is_reset_to_a_given_seed(make_env: Any) -> None:
    env = VectorDrivingEnv(SCENARIOS, 2, autoreset_mode=AutoresetMode.DISABLED)
    go = np.tile(np.float32([6.0, 0.0]), (2, 1))
    env.reset(seed=[7, 5])
    before = env.step(go)[0]
    after, infos = env.reset(seed=[8, 6], options={"reset_mask": np.array([True, False])})
    stepped = env.step(go)[0]
    next_of_run = env.reset()[1]
    env.close()
    assert infos["episode_number"].tolist() == [-1, -1]
    assert next_of_run["episode_number"].tolist() == [0, 1]
    for name, array in before.items():
        np.testing.assert_array_equal(after[name][1], array[1])
    alone: DrivingEnv = make_env(SCENARIOS[8 % 3])
    first, _ = alone.reset(seed=8)
    second = alone.step({"ego-0": go[0]})[0]
    for name in before:
        np.testing.assert_array_equal(after[name][0], first["ego-0"][name])
        np.testing.assert_array_equal(stepped[name][0], second["ego-0"][name])


def test_egos_are_rows_that_learners_take() -> None:
    rows = scenario_rows([near_and_far()], 1, reward="progress")
    assert (rows.num_envs, rows.group_size) == (2, 2)
    first, _ = rows.reset(seed=[3, None])
    assert first["route"].shape == (2, 80, 7)
    success = np.full(2, np.nan)
    while rows.running.any():
        *_, infos = rows.step(np.full((2, 2), [3.0, 0.0], np.float32))
        success = np.where(infos.get("_success", False), infos.get("success", np.nan), success)
    rows.close()
    assert success.tolist() == [1.0, 0.0]


def test_a_step_before_the_first_reset_is_an_error() -> None:
    env = VectorDrivingEnv(SCENARIOS, 1)
    with pytest.raises(SimulationError, match="has not been reset"):
        env.step(np.zeros((1, 2), np.float32))
    env.close()


def test_an_error_in_a_worker_arrives_as_itself() -> None:
    with pytest.raises(UnknownNameError) as plain:
        DrivingEnv(broken_second(1))
    env = VectorDrivingEnv(broken_second, 2)
    with pytest.raises(UnknownNameError) as error:
        env.reset(seed=0)
    assert str(error.value) == str(plain.value)
    assert "in worker 1" in error.value.__notes__[0]
    env.reset()  # its next episode is sound
    env.step(np.zeros((2, 2), np.float32))
    env.close()


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ({"scenarios": (), "num_envs": 1}, "no scenario"),
        ({"scenarios": (scenario(5.0), scenario(5.0, 9.0)), "num_envs": 1}, "the same number of egos"),
        ({"scenarios": "quickstart", "num_envs": 1}, "expected a Scenario .*, got 'quickstart'"),
        ({"scenarios": 5, "num_envs": 1}, "expected a Scenario .*, got 5"),
        ({"scenarios": lambda episode: episode, "num_envs": 1}, "expected a Scenario .*, got 0"),
        ({"scenarios": SCENARIOS, "num_envs": 0}, "at least one"),
        ({"scenarios": SCENARIOS, "num_envs": "2"}, "a whole number, got num_envs='2'"),
        ({"scenarios": SCENARIOS, "num_envs": 1.5}, "a whole number, got num_envs=1.5"),
        ({"scenarios": SCENARIOS, "num_envs": 1, "sensors": ["rader"]}, "rader"),
        ({"scenarios": SCENARIOS, "num_envs": 1, "sensors": "radar"}, "expected a list of .*, got 'radar'"),
        ({"scenarios": SCENARIOS, "num_envs": 1, "sensors": {"ego-0": ["radar"]}}, "expected a list of"),
        ({"scenarios": SCENARIOS, "num_envs": 1, "control": "reins"}, "reins"),
        ({"scenarios": SCENARIOS, "num_envs": 1, "reward": "gold"}, "gold"),
        ({"scenarios": SCENARIOS, "num_envs": 1, "render_mode": "human"}, "rgb_array"),
    ],
)
def test_impossible_orders_start_no_process(arguments: dict[str, Any], says: str) -> None:
    before = children(os.getpid())
    with pytest.raises(InvalidInputError, match=says):
        VectorDrivingEnv(**arguments)
    assert children(os.getpid()) == before


def test_a_killed_worker_is_named_and_all_the_others_end() -> None:
    env = VectorDrivingEnv(SCENARIOS, 2)
    env.reset(seed=0)
    pids = env.pids
    os.kill(pids[1], signal.SIGKILL)
    with pytest.raises(SimulationError, match=rf"worker 1 \(process {pids[1]}\) ended with code -9"):
        env.step(np.zeros((2, 2), np.float32))
    assert gone(pids)
    with pytest.raises(SimulationError, match="closed"):
        env.step(np.zeros((2, 2), np.float32))
    env.close()


def test_a_forgotten_environment_ends_its_processes() -> None:
    env = VectorDrivingEnv(SCENARIOS, 1)
    pids = env.pids
    del env
    gc.collect()
    assert gone(pids)


PROGRAM = """
import signal
import sys
import numpy as np
from dohyo.sumo_networks.envs.scenario_env import scenario_rows
from dohyo.sumo_networks.envs.vector_env import VectorDrivingEnv
from tests.sumo_networks.envs.test_vector_env import scenario
if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.default_int_handler)  # what a shell starts in the background ignores it
    env = VectorDrivingEnv([scenario(5.0, limit_s=1e6)], 1)
    env.reset(seed=0)
    print(*env.pids, flush=True)
    while "--exit" not in sys.argv:
        env.step(np.zeros((1, 2), np.float32))
"""


@pytest.mark.parametrize(("how", "code"), [("exit", 0), ("ctrl-c", -signal.SIGINT), ("kill", -signal.SIGKILL)])
def test_however_the_parent_ends_nothing_is_left(tmp_path: Path, how: str, code: int) -> None:
    (tmp_path / "program.py").write_text(PROGRAM)
    process = subprocess.Popen(
        [sys.executable, str(tmp_path / "program.py"), f"--{how}"],
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    assert process.stdout is not None
    pids = tuple(int(pid) for pid in process.stdout.readline().split())
    assert len(pids) == 1
    time.sleep(0.2)
    if how != "exit":
        shared = shared_memory((process.pid, *pids))
        assert len(shared) >= 2
        assert all(line.endswith("(deleted)") for line in shared), "memory that somebody would have to remove"
    if how == "ctrl-c":
        os.killpg(process.pid, signal.SIGINT)  # as a terminal does
    elif how == "kill":
        process.kill()
    _, errors = process.communicate(timeout=120)
    assert process.returncode == code, errors
    assert gone(pids)
    if how == "ctrl-c":
        assert errors.count("Traceback") == 1, errors


def shared_memory(pids: tuple[int, ...]) -> list[str]:
    """The mappings of multiprocessing's shared arrays."""
    return [line for pid in pids for line in Path(f"/proc/{pid}/maps").read_text().splitlines() if "/pym-" in line]


def children(pid: int) -> set[str]:
    return set(Path(f"/proc/{pid}/task/{pid}/children").read_text().split())


def gone(pids: tuple[int, ...]) -> bool:
    """Whether processes end."""
    patience = time.monotonic() + 120
    while any(Path(f"/proc/{pid}").exists() for pid in pids):
        if time.monotonic() > patience:
            return False
        time.sleep(0.02)
    return True


@pytest.mark.filterwarnings("ignore:.*WeightUpdater:DeprecationWarning")
@pytest.mark.parametrize("egos", [1, 2])
def test_a_torchrl_collector_collects(egos: int) -> None:
    from torchrl.collectors import Collector
    from torchrl.envs.utils import check_env_specs

    from dohyo.sumo_networks.envs.torchrl_env import make_torchrl_env

    env = make_torchrl_env([scenario(*(5.0, 15.0)[:egos], limit_s=0.6)], 2)
    check_env_specs(env)
    env.set_seed(2)
    collector = Collector(env, None, frames_per_batch=32, total_frames=64)
    batches = list(collector)
    collector.shutdown()
    assert env.is_closed
    assert [tuple(batch.batch_size) for batch in batches] == [(2, 16), (2, 16)]
    done = batches[0]["next", "done"].squeeze(-1)
    assert done.sum(dim=1).tolist() == [2, 2]  # every sixth step
    assert bool((batches[0]["next", "done"] == batches[0]["next", "truncated"]).all())
    inner = batches[0]["next", "agents"] if egos > 1 else batches[0]["next"]
    assert inner["route"].shape == ((2, 16, 80, 7) if egos == 1 else (2, 16, egos, 80, 7))
    if egos > 1:
        assert not bool((inner["mask"] & inner["done"].squeeze(-1)).any())


@pytest.mark.slow
def test_torchrl_collects_in_processes_of_its_own() -> None:
    from functools import partial

    from torchrl.collectors import MultiAsyncCollector

    from dohyo.sumo_networks.envs.torchrl_env import make_torchrl_env

    make = partial(make_torchrl_env, [scenario(5.0, limit_s=0.6)], 1, seed=0)
    collector = MultiAsyncCollector([make], None, frames_per_batch=12, total_frames=24)
    frames = sum(batch.numel() for batch in collector)
    collector.shutdown()
    assert frames == 24
