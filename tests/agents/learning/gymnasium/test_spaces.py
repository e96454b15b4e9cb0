"""Spaces of other libraries' environments, in the form that learners use."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.spaces import Box, Dict, Discrete, Space

from dohyo.agents.learning.gymnasium.spaces import in_our_form
from dohyo.agents.learning.tasks.task import Env
from dohyo.sumo_networks.errors import InvalidInputError
from tests.agents.learning.foreign import CABINET, Drawn
from tests.agents.learning.problems import PictureEnv


def ours(observations: Space[Any], actions: Space[Any] | None = None) -> tuple[Drawn, Env]:
    env = Drawn(observations, actions or Discrete(2))
    return env, in_our_form(env, "drawn")


def test_parts_become_named_vectors_with_the_same_numbers() -> None:
    _, env = ours(CABINET)
    sizes = {name: space.shape for name, space in env.observation_space.items()}
    expected = {"goal": 3, "nested.grid": 4, "nested.flags": 3, "choice": 4, "pair.0": 2, "pair.1": 1}
    assert sizes == {name: (size,) for name, size in expected.items()}
    seen, _ = env.reset(seed=3)
    CABINET.seed(3)
    theirs = CABINET.sample()
    assert env.observation_space.contains(seen)
    assert seen["goal"] == pytest.approx(theirs["goal"])
    assert (seen["nested.grid"].reshape(2, 2) == theirs["nested"]["grid"]).all()
    assert seen["choice"].argmax() == theirs["choice"] - 2
    assert seen["choice"].sum() == 1.0
    assert seen["pair.1"] == theirs["pair"][1]


@pytest.mark.parametrize(
    ("theirs", "form"),
    [((4, 5, 3), (3, 4, 5)), ((3, 4, 5), (3, 4, 5)), ((4, 5), (1, 4, 5)), ((2, 2, 2), (2, 2, 2))],
)
def test_pictures_come_channels_first(theirs: tuple[int, ...], form: tuple[int, ...]) -> None:
    _, env = ours(Box(0, 255, theirs, np.uint8))
    assert env.observation_space == Dict({"observation": Box(0, 255, form, np.uint8)})
    assert env.observation_space.contains(env.reset(seed=0)[0])


def test_a_picture_is_the_same_picture() -> None:
    picture = in_our_form(PictureEnv(), "picture").reset(seed=0)[0]["observation"]
    assert picture[2, 1, 4] == 241  # channel, row, column


def test_actions_arrive_in_the_environments_space() -> None:
    box = Box(np.array([[-0.1], [0.2]]), np.array([[0.1], [0.3]]), dtype=np.float64)
    inner, env = ours(CABINET, box)
    env.reset(seed=0)
    assert env.action_space.shape == (2,)
    for action in (env.action_space.low, env.action_space.high):
        env.step(action)
    assert inner.actions[0].shape == (2, 1)
    inner, env = ours(CABINET, Discrete(3, start=-1))
    env.reset(seed=0)
    env.step(0)
    assert env.action_space == Discrete(3)
    assert inner.actions == [-1]


def test_a_wrong_shape_is_no_vector() -> None:
    inner, env = ours(Box(-1.0, 1.0, (2, 2), np.float64))
    inner.observation_space = Box(-1.0, 1.0, (4,), np.float64)
    with pytest.raises(ValueError, match=r"shape \(2, 2\), got \(4,\)"):
        env.reset(seed=0)


def test_what_is_no_number_is_refused() -> None:
    with pytest.raises(InvalidInputError, match=r"'written': observation 'observation': expected a Box.*got Text"):
        in_our_form(gymnasium.make("tests.agents.learning.foreign:Written-v0"), "written")


VECTOR, WIDEST = Box(-1.0, 1.0, (2,), np.float32), float(np.finfo(np.float32).max)


@pytest.mark.parametrize(
    ("observations", "actions", "message"),
    [
        (Box(-1.0, 1.0, (0,), np.float32), VECTOR, r"in observation 'observation', got shape \(0,\)"),
        (Dict(a=VECTOR, b=Box(0, 1, (0, 2), np.int64)), VECTOR, r"in observation 'b', got shape \(0,\)"),
        (Box(0, 255, (4, 0, 3), np.uint8), VECTOR, r"in observation 'observation', got shape \(3, 4, 0\)"),
        (VECTOR, Box(-1.0, 1.0, (0,), np.float32), r"in actions, got shape \(0,\)"),
        (VECTOR, Box(-WIDEST, WIDEST, (1,), np.float32), r"bounds of at most 1\.8e\+19, got -3\.4e\+38 to 3\.4e\+38"),
        (VECTOR, Box(np.array([-1.0, 0.0]), np.array([1.0, 1e300]), dtype=np.float64), r"got -1 to inf"),
    ],
)
def test_empty_parts_and_boundless_actions_are_refused(
    observations: Space[Any], actions: Space[Any], message: str
) -> None:
    with pytest.raises(InvalidInputError, match=message):
        ours(observations, actions)


def test_observations_may_be_as_wide_as_float32() -> None:
    _, env = ours(Box(-WIDEST, WIDEST, (2,), np.float32), Box(-1e6, 1e6, (1,), np.float32))
    assert env.observation_space == Dict(observation=Box(-WIDEST, WIDEST, (2,), np.float32))
