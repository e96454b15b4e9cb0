"""SingleDrivingEnv: as gymnasium understands environments."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any, ClassVar

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import check_env
from gymnasium.wrappers import RecordVideo, TimeLimit

from dohyo.sumo_networks.envs.single_env import SingleDrivingEnv
from dohyo.sumo_networks.errors import InvalidInputError, UnknownNameError
from dohyo.sumo_networks.scenario import Mission, Place, Scenario, Traffic
from tests.sumo_networks.simulation.drives import in_ingolstadt

LIGHT_TRAFFIC = Traffic(vehicles=6, pedestrians=6, warm_up_s=2.0)
FIRST = in_ingolstadt(name="first", traffic=LIGHT_TRAFFIC, time_limit_s=0.95)
SECOND = in_ingolstadt(
    name="second",
    traffic=LIGHT_TRAFFIC,
    time_limit_s=0.45,
    missions=(Mission(start=Place(lane="29119849#1_2", position_m=8.0), goal=Place(lane="54169280#2_2")),),
)


@pytest.fixture
def env() -> Iterator[SingleDrivingEnv]:
    env = SingleDrivingEnv((FIRST, SECOND), render_mode="rgb_array")
    yield env
    env.close()


@pytest.mark.filterwarnings("ignore::UserWarning")  # it advises bounded observations and actions in [-1, 1]
def test_gymnasium_accepts_it(env: SingleDrivingEnv) -> None:
    check_env(env)


def episode(env: gymnasium.Env[Any, Any], seed: int | None) -> list[Any]:
    observation, info = env.reset(seed=seed)
    env.action_space.seed(1)
    seen: list[Any] = [observation, info]
    while not (len(seen) > 2 and (seen[-1][2] or seen[-1][3])):
        seen.append(env.step(env.action_space.sample()))
    return seen


def test_a_seed_decides_the_episode_and_all_that_follow(env: SingleDrivingEnv) -> None:
    first = [episode(env, 5), episode(env, None), episode(env, None)]
    again = [episode(env, 5), episode(env, None), episode(env, None)]
    np.testing.assert_equal(again, first)
    assert len({one[1]["seed"] for one in first}) == 3, "each episode has a seed of its own"


def test_every_scenario_is_drawn_and_no_seed_is_held_out(env: SingleDrivingEnv) -> None:
    infos = [env.reset(seed=seed)[1] for seed in range(8)]
    assert {info["scenario"] for info in infos} == {"first", "second"}
    assert all(0 <= info["seed"] < 2**30 for info in infos)


def test_the_time_limit_truncates_and_then_it_must_be_reset(env: SingleDrivingEnv) -> None:
    seen = episode(env, 0)
    assert seen[-1][3] is True
    with pytest.raises(ResetNeeded):
        env.step(env.action_space.sample())


def test_a_reset_ends_the_episode_of_another_one_in_the_process(env: SingleDrivingEnv) -> None:
    other = SingleDrivingEnv(FIRST)
    env.reset(seed=0)
    other.reset(seed=0)
    with pytest.raises(ResetNeeded, match="another environment of this process"):
        env.step(env.action_space.sample())
    other.step(other.action_space.sample())
    other.close()


def test_a_cell_of_a_notebook_runs_twice() -> None:
    for _ in range(2):
        wrapped = TimeLimit(SingleDrivingEnv(FIRST, sensors=("speedometer",)), 5)  # the first one is dropped unclosed
        wrapped.reset(seed=0)
    wrapped.close()


def test_it_draws_what_is_around_the_ego(env: SingleDrivingEnv) -> None:
    env.reset(seed=0)
    frame = env.render()
    assert frame is not None
    assert (frame.shape, frame.dtype, env.metadata["render_fps"]) == ((480, 480, 3), np.uint8, 10)
    assert SingleDrivingEnv(FIRST).render() is None


class Clip:
    """A stand-in for moviepy's clip: it keeps what would be written into the file."""

    written: ClassVar[dict[str, tuple[int, float]]] = {}

    def __init__(self, frames: list[np.ndarray[Any, Any]], fps: float) -> None:
        assert {frame.shape for frame in frames} == {(480, 480, 3)}
        self._frames, self._fps = len(frames), fps

    def write_videofile(self, path: str, logger: object) -> None:
        Clip.written[Path(path).name] = self._frames, self._fps


def test_gymnasiums_recorder_takes_every_frame_of_an_episode_also_the_last(
    env: SingleDrivingEnv, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    package, module = ModuleType("moviepy"), ModuleType("moviepy.video.io.ImageSequenceClip")
    module.ImageSequenceClip = Clip  # type: ignore[attr-defined]
    for name in (package.__name__, "moviepy.video", "moviepy.video.io"):
        monkeypatch.setitem(sys.modules, name, package)
    monkeypatch.setitem(sys.modules, module.__name__, module)
    recorded = RecordVideo(env, str(tmp_path / "videos"), episode_trigger=lambda number: number == 1)
    for _ in range(2):
        recorded.reset(seed=0)
        ticks, ended = 0, False
        while not ended:
            _, _, terminated, truncated, _ = recorded.step(np.zeros(2, np.float32))
            ticks, ended = ticks + 1, terminated or truncated
    recorded.close()
    assert Clip.written == {"rl-video-episode-1.mp4": (ticks + 1, 10)}


def two_egos() -> Scenario:
    ahead = FIRST.missions[0].model_copy(update={"name": "second"})
    return FIRST.model_copy(update={"missions": (*FIRST.missions, ahead)})


@pytest.mark.parametrize(
    ("scenarios", "options", "error", "says"),
    [
        ((), {}, InvalidInputError, "at least one scenario"),
        (5, {}, InvalidInputError, "expected a Scenario .*, got 5"),
        (None, {}, InvalidInputError, "expected a Scenario .*, got None"),
        ([FIRST, "second"], {}, InvalidInputError, "expected a Scenario .*, got 'second'"),
        (two_egos(), {}, InvalidInputError, "expected one ego, got 2"),
        (FIRST, {"render_mode": "human"}, UnknownNameError, "no render mode named 'human'"),
    ],
)
def test_impossible_ones_are_refused(
    scenarios: Any, options: dict[str, Any], error: type[Exception], says: str
) -> None:
    with pytest.raises(error, match=says):
        SingleDrivingEnv(scenarios, **options)
