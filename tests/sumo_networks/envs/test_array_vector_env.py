"""ArrayVectorEnv: rows are reset alone, and an episode follows from its seed and its actions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pytest
from gymnasium.spaces import Box

from dohyo.sumo_networks.arrays import FloatArray, IntArray
from dohyo.sumo_networks.ego.control import InvalidActionError
from dohyo.sumo_networks.envs.array_vector_env import ArrayVectorEnv
from dohyo.sumo_networks.errors import InvalidInputError, SimulationError

LENGTH = 3


class Walk(ArrayVectorEnv):
    """A place that begins at random, and moves by the action; the reward is the place."""

    def __init__(self, num_envs: int) -> None:
        super().__init__(
            num_envs, Box(-9, 9, (1,), np.float32), Box(-1, 1, (1,), np.float32), LENGTH, measures=("place",)
        )
        self.place = np.zeros(num_envs)

    def _begin(self, rows: IntArray, generators: Sequence[np.random.Generator]) -> None:
        self.place[rows] = [rng.normal() for rng in generators]

    def _advance(self, rows: IntArray, actions: FloatArray) -> FloatArray:
        self.place[rows] += actions[:, 0]
        return self.place[rows]

    def _observed(self, rows: IntArray) -> FloatArray:
        return np.column_stack([self.place[rows] + 100 * self._steps[rows]])

    def _measured(self, rows: IntArray) -> Mapping[str, FloatArray]:
        return {"place": self.place[rows]}


def ones(env: Walk) -> FloatArray:
    return np.ones((env.num_envs, 1))


def test_a_row_is_reset_alone_and_keeps_its_own_time() -> None:
    env = Walk(2)
    first, _ = env.reset(seed=[4, 5])
    env.step(ones(env))
    seen, _ = env.reset(seed=[6, None], options={"reset_mask": np.array([True, False])})
    begin = np.random.default_rng(6).normal()
    assert seen["observation"][:, 0] == pytest.approx([begin, first["observation"][1, 0] + 101])
    for ended in ([False, False], [False, True], [True, False]):
        *_, terminated, truncated, infos = env.step(ones(env))
        assert truncated.tolist() == ended
        assert not terminated.any()
        assert ("place" in infos) == any(ended)
    assert infos["_place"].tolist() == [True, False]
    assert infos["place"][0] == pytest.approx(begin + LENGTH)


def test_a_row_that_has_ended_ignores_its_action() -> None:
    env = Walk(2)
    env.reset(seed=0)
    env.step(ones(env))
    env.reset(seed=[None, 1], options={"reset_mask": np.array([False, True])})
    for _ in range(LENGTH - 1):
        last, *_ = env.step(ones(env))
    seen, rewards, terminated, truncated, infos = env.step(ones(env))
    assert infos["active"].tolist() == [False, True]
    assert (rewards[0], bool(terminated[0]), bool(truncated[0])) == (0.0, False, False)
    assert seen["observation"][0] == last["observation"][0]
    assert truncated[1]


def test_wrong_seeds_masks_and_actions_are_refused() -> None:
    env = Walk(2)
    with pytest.raises(InvalidInputError, match="expected 2 seeds, got 3"):
        env.reset(seed=[1, 2, 3])
    with pytest.raises(InvalidInputError, match="mask of shape"):
        env.reset(options={"reset_mask": np.ones(3, np.bool_)})
    env.reset(seed=0)
    for actions in (np.ones((3, 1)), np.full((2, 1), np.nan)):
        with pytest.raises(InvalidActionError):
            env.step(actions)
    with pytest.raises(InvalidInputError, match="at least one row"):
        Walk(0)
    env.close()
    with pytest.raises(SimulationError, match="Walk is closed"):
        env.step(ones(env))
