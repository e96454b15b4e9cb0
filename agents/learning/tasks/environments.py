"""Environments: what every learner expects of gymnasium's `VectorEnv`, and wrappers that keep it.

* `single_observation_space` is a Dict of float32 vectors (O,) and uint8 pictures (C, H, W); `single_action_space` is a
  bounded float32 vector or Discrete; `metadata["autoreset_mode"]` is DISABLED, since the collector resets.
* `reset(seed=[...], options={"reset_mask": (N,), "level": int})` begins new episodes in the rows of the mask
  alone, each with its own seed; "level" is given if the task has a curriculum. With "begin_after" the rows may begin
  so many steps later, while the others act; until then they ignore their action.
* `step` returns an episode's true last observation at its end; rows that have ended ignore their action.
* `infos` may hold (N,) arrays: "active" (the row acted), "lost" (its simulation failed, the row must be reset), "begun"
  (its episode begins with this observation), and at an episode's end "success" and the task's measures.
* Optional: `group_size` (rows of one simulation, which are reset together), `expert_actions(rows)` -> (N, ...) actions
  and (N,) whether there is one, `step_async` and `step_wait`.
"""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box, Dict
from gymnasium.vector import AutoresetMode, VectorEnv, VectorWrapper
from gymnasium.vector.utils import batch_space

from dohyo.agents.learning.tasks.task import Array, Environments, check_spaces
from dohyo.sumo_networks.arrays import BoolArray
from dohyo.sumo_networks.errors import InvalidInputError

Reset = tuple[dict[str, Array], dict[str, Any]]
WIDEST_ACTION = float(np.sqrt(np.finfo(np.float32).max))
"""Bound of actions whose square still is a float32; learners scale actions by their bounds, and square them."""
Step = tuple[dict[str, Array], Array, BoolArray, BoolArray, dict[str, Any]]


def check_environments(environments: Environments) -> None:
    """Raises InvalidInputError if a learner cannot use these environments."""
    what = f"environments {type(environments.unwrapped).__name__}"
    check_spaces(what, environments.single_observation_space, environments.single_action_space)
    check_extents(what, environments.single_observation_space, environments.single_action_space)
    mode = environments.metadata.get("autoreset_mode")
    if mode is not AutoresetMode.DISABLED:
        raise InvalidInputError(f"{what}: expected AutoresetMode.DISABLED, since the collector resets, got {mode}")
    group = getattr(environments, "group_size", 1)
    if group < 1 or environments.num_envs % group:
        raise InvalidInputError(f"{what}: expected groups that divide {environments.num_envs} rows, got {group}")


def check_extents(what: str, observations: gymnasium.Space[Any], actions: gymnasium.Space[Any]) -> None:
    """Checks that no part of an environment's spaces is empty, and that its actions are bounded in practice.

    Bounds of observations may be as wide as float32, since nothing is scaled by them.

    Args:
        what: Its name, for the error.
        observations: By name.
        actions: Of one environment.

    Raises:
        InvalidInputError: One is not so.
    """
    named = observations.spaces.items() if isinstance(observations, Dict) else ()
    parts = {f"observation '{name}'": space for name, space in named} | {"actions": actions}
    for part, space in parts.items():
        if 0 in (space.shape or ()):
            raise InvalidInputError(f"{what}: expected at least one number in {part}, got shape {space.shape}")
    if not isinstance(actions, Box):
        return
    low, high = float(actions.low.min()), float(actions.high.max())
    if max(-low, high) > WIDEST_ACTION:
        raise InvalidInputError(
            f"{what}: expected actions with bounds of at most {WIDEST_ACTION:.2g}, got {low:.2g} to {high:.2g}"
        )


class _Counted(VectorWrapper):
    """Wrapper with a count, that offers all that the environments offer.

    Attributes:
        count: At least 1.
    """

    def __init__(self, environments: VectorEnv[Any, Any, Any], count: int) -> None:
        """Wraps environments.

        Args:
            environments: See the module.
            count: See the wrapper.

        Raises:
            InvalidInputError: The count is below 1.
        """
        if count < 1:
            raise InvalidInputError(f"{type(self).__name__}: expected a count of at least 1, got {count}")
        super().__init__(environments)
        self.count = count

    def __getattr__(self, name: str) -> Any:
        """What the environments offer beside gymnasium's methods."""
        if name.startswith("_"):
            raise AttributeError(name)
        return getattr(self.env, name)


class ActionRepeat(_Counted):
    """Repeats every action for `count` steps; rewards are summed, and a row that ends does not act on."""

    def __getattr__(self, name: str) -> Any:
        """As all wrappers, but for asynchronous steps, of which only the first could be."""
        if name in ("step_async", "step_wait"):
            raise AttributeError(name)
        return super().__getattr__(name)

    def reset(self, *, seed: Any = None, options: dict[str, Any] | None = None) -> Reset:
        """See `VectorEnv`. Rows begin at once: a later one would begin amid a repeated action."""
        kept = {name: value for name, value in (options or {}).items() if name != "begin_after"}
        return self.env.reset(seed=seed, options=kept)

    def step(self, actions: Array) -> Step:
        """See `VectorEnv`."""
        observation, reward, terminated, truncated, infos = self.env.step(actions)
        for _ in range(self.count - 1):
            over = terminated | truncated
            if over.all():
                break
            last = observation
            observation, more, ended, cut, later = self.env.step(actions)
            observation = _chosen(over, last, observation)
            reward = reward + np.where(over, 0.0, more)
            terminated, truncated = terminated | (ended & ~over), truncated | (cut & ~over)
            infos = _merged(infos, later, ~over)
        return observation, reward, terminated, truncated, infos


class FrameStack(_Counted):
    """Stacks the last `count` pictures along their channels; an episode's first one is repeated. Vectors stay."""

    def __init__(self, environments: VectorEnv[Any, Any, Any], count: int) -> None:
        """See `_Counted`."""
        super().__init__(environments, count)
        spaces = environments.single_observation_space
        assert isinstance(spaces, Dict)
        self._pictures = [name for name, space in spaces.items() if len(space.shape or ()) == 3]
        stacked = {name: _stacked(space, count) if name in self._pictures else space for name, space in spaces.items()}
        self.single_observation_space = Dict(stacked)
        self.observation_space = batch_space(self.single_observation_space, environments.num_envs)
        self._stacks: dict[str, Array] = {}

    def reset(self, *, seed: Any = None, options: dict[str, Any] | None = None) -> Reset:
        """See `VectorEnv`."""
        observation, infos = self.env.reset(seed=seed, options=options)
        mask = (options or {}).get("reset_mask")
        self._fill(observation, np.ones(self.num_envs, np.bool_) if mask is None else mask)
        return self._with_stacks(observation), infos

    def step(self, actions: Array) -> Step:
        """See `VectorEnv`."""
        return self._pushed(self.env.step(actions))

    def step_wait(self) -> Step:
        """The end of a step that `step_async` began."""
        return self._pushed(self.env.step_wait())  # type: ignore[attr-defined]

    def _pushed(self, step: Step) -> Step:
        observation, *rest, infos = step
        for name in self._pictures:
            new = observation[name]
            self._stacks[name] = np.concatenate([self._stacks[name][:, new.shape[1] :], new], axis=1)
        if "begun" in infos:
            self._fill(observation, infos["begun"])
        return self._with_stacks(observation), *rest, infos  # type: ignore[return-value]

    def _fill(self, observation: dict[str, Array], rows: BoolArray) -> None:
        """Repeats the present pictures of rows that begin."""
        for name in self._pictures:
            tiled = np.tile(observation[name], (1, self.count, 1, 1))
            if name in self._stacks:
                tiled[~rows] = self._stacks[name][~rows]
            self._stacks[name] = tiled

    def _with_stacks(self, observation: dict[str, Array]) -> dict[str, Array]:
        return observation | {name: self._stacks[name] for name in self._pictures}


def _stacked(space: Any, count: int) -> Box:
    return Box(np.tile(space.low, (count, 1, 1)), np.tile(space.high, (count, 1, 1)), dtype=np.uint8)


def _chosen(rows: BoolArray, ours: dict[str, Array], others: dict[str, Array]) -> dict[str, Array]:
    """The first observations in some rows, the others elsewhere."""
    if not rows.any():
        return others
    return {name: np.where(rows.reshape(-1, *[1] * (ours[name].ndim - 1)), ours[name], others[name]) for name in ours}


def _merged(first: dict[str, Any], later: dict[str, Any], rows: BoolArray) -> dict[str, Any]:
    """Infos of two steps; those of the later one in some rows."""
    merged = dict(first)
    for name, values in later.items():
        kept = first.get(name)
        merged[name] = np.where(rows, values, kept if kept is not None else np.zeros_like(values))
    return merged
