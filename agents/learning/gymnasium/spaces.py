"""Spaces of any gymnasium environment in the form of `task.check_spaces`: named float32 vectors and uint8 pictures."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial, reduce
from operator import getitem
from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box, Dict, Discrete, MultiBinary, MultiDiscrete, Tuple
from gymnasium.spaces.utils import flatten, flatten_space
from gymnasium.wrappers import TransformAction, TransformObservation

from dohyo.agents.learning.tasks.environments import check_extents
from dohyo.agents.learning.tasks.task import SINGLE, Array, Env
from dohyo.sumo_networks.errors import InvalidInputError

Convert = Callable[[Any], Array]


def in_our_form(env: gymnasium.Env[Any, Any], name: str) -> Env:
    """The environment with observations and actions that learners can use, where there are any.

    * Numbers of any type and shape become a float32 vector; Discrete and MultiDiscrete become one-hot vectors.
    * Pictures of uint8 become (C, H, W). The smallest number of a shape is that of the channels, as in
      stable-baselines3, unless only the last one can be.
    * The parts of a Dict or Tuple keep their names or numbers; those of nested ones are joined by dots.
    * Actions of a Box become a float32 vector, and those of Discrete begin at 0.

    Args:
        env: As its author made it.
        name: For errors.

    Raises:
        InvalidInputError: Its observations are of another kind, or a space is not as `check_extents` expects.
    """
    parts: dict[str, tuple[Box, Convert]] = {}
    for path, space in _leaves(env.observation_space):
        key = ".".join(map(str, path)) or SINGLE
        if key in parts:
            raise InvalidInputError(
                f"environment '{name}': expected different names of observations, got '{key}' twice"
            )
        parts[key] = _form(space, f"environment '{name}': observation '{key}'")
    paths = [path for path, _ in _leaves(env.observation_space)]

    def convert(observation: Any) -> dict[str, Array]:
        values = (reduce(getitem, path, observation) for path in paths)
        return {key: form(value) for (key, (_, form)), value in zip(parts.items(), values, strict=True)}

    observations = Dict({key: box for key, (box, _) in parts.items()})
    acting = _with_our_actions(env)
    check_extents(f"environment '{name}'", observations, acting.action_space)
    return TransformObservation(acting, convert, observations)


def _leaves(space: gymnasium.Space[Any], path: tuple[Any, ...] = ()) -> Iterator[tuple[tuple[Any, ...], Any]]:
    """Parts of a space that have no parts, with the names that lead to them."""
    if isinstance(space, Dict):
        for name, part in space.spaces.items():
            yield from _leaves(part, (*path, name))
    elif isinstance(space, Tuple):
        for index, part in enumerate(space.spaces):
            yield from _leaves(part, (*path, index))
    else:
        yield path, space


def _form(space: gymnasium.Space[Any], what: str) -> tuple[Box, Convert]:
    """Our form of a space without parts, and what converts a value to it."""
    if isinstance(space, Box) and space.dtype == np.uint8 and len(space.shape) in (2, 3):
        return _picture_form(space)
    if isinstance(space, Box | Discrete | MultiDiscrete | MultiBinary):
        flat = flatten_space(space)
        assert isinstance(flat, Box)
        return _float32_box(flat), partial(_vector, space)
    raise InvalidInputError(f"{what}: expected a Box, Discrete, MultiDiscrete or MultiBinary, got {space}")


def _picture_form(space: Box) -> tuple[Box, Convert]:
    form = partial(_channels_first, space.shape)
    return Box(form(space.low), form(space.high), dtype=np.uint8), form


def _channels_first(shape: tuple[int, ...], value: Any) -> Array:
    picture: Array = np.asarray(value)
    if picture.shape != shape:
        raise ValueError(f"expected a picture of shape {shape}, got {picture.shape}")
    if len(shape) == 2:
        return picture[None]
    return picture if shape[0] < min(shape[1:]) else picture.transpose(2, 0, 1)


def _vector(space: gymnasium.Space[Any], value: Any) -> Array:
    if isinstance(space, Box) and np.shape(value) != space.shape:
        raise ValueError(f"expected an observation of shape {space.shape}, got {np.shape(value)}")
    return np.asarray(flatten(space, value), np.float32)


def _float32_box(space: Box) -> Box:
    with np.errstate(over="ignore"):  # bounds beyond those of float32 become infinite
        return Box(space.low.astype(np.float32).ravel(), space.high.astype(np.float32).ravel(), dtype=np.float32)


def _with_our_actions(env: gymnasium.Env[Any, Any]) -> gymnasium.Env[Any, Any]:
    space = env.action_space
    if isinstance(space, Discrete) and space.start != 0:
        return TransformAction(env, lambda action: action + space.start, Discrete(int(space.n)))
    if not isinstance(space, Box) or (space.dtype == np.float32 and len(space.shape) == 1):
        return env
    if not np.issubdtype(space.dtype, np.floating):
        return env  # refused by `task.check_spaces`: fractions of an integer mean nothing
    return TransformAction(env, lambda action: _its_action(space, action), _float32_box(space))


def _its_action(space: Box, action: Array) -> Array:
    """A vector of float32 as the environment wants it; float32's rounding must not leave the bounds."""
    return np.clip(action.reshape(space.shape).astype(space.dtype), space.low, space.high)
