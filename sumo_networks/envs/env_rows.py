"""EnvRows: one environment, and the rows of a vector environment's arrays that it reads and writes."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box, Dict, Discrete
from numpy.typing import ArrayLike, DTypeLike, NDArray

from dohyo.sumo_networks.arrays import BoolArray, Float32Array, FloatArray
from dohyo.sumo_networks.ego.control import InvalidActionError
from dohyo.sumo_networks.envs.shared_memory import Layout
from dohyo.sumo_networks.errors import DohyoError, InvalidInputError, SimulationError
from dohyo.sumo_networks.seeds import checked_seed

logger = logging.getLogger(__name__)

Observations = dict[str, NDArray[Any]]

BARE = "observation"
"""Name of an observation that comes without one."""
_PICTURE = "picture/"
LARGEST_REWARD = float(np.finfo(np.float32).max)
"""Of one step: learners compute with float32."""


class EnvError(DohyoError):
    """The code of an environment failed, or broke its contract."""


@dataclass(frozen=True, slots=True)
class RowPlan:
    """The environments of a vector environment, and what its rows hold; sent to workers once.

    Attributes:
        make_env: Makes the environment of a rank: a gymnasium environment, or with several agents a ParallelEnv of
            PettingZoo whose `possible_agents` are the rows. It is called at the first reset.
        groups: Number of environments.
        group_size: Agents of one environment.
        observation_space: Of one agent, see `named_space`.
        action_space: Of one agent.
        measures: Names of the floats in the last info of an episode, beside "success": true, false, 0 or 1; without it
            false.
    """

    make_env: Callable[[int], Any]
    groups: int
    group_size: int
    observation_space: Dict
    action_space: Box | Discrete
    measures: tuple[str, ...]

    def layout(self) -> Layout:
        """Types and shapes of the arrays of all rows."""
        rows, action = self.groups * self.group_size, self.action_space
        flag, boxes = (np.bool_, (rows,)), _boxes(self.observation_space)
        actions = (np.float32, (rows, *action.shape)) if isinstance(action, Box) else (np.int64, (rows,))
        return {
            "actions": actions,
            "expert_actions": actions,
            "expert_known": flag,
            "rewards": (np.float64, (rows,)),
            "terminations": flag,
            "truncations": flag,
            "successes": flag,
            "measures": (np.float64, (rows, len(self.measures))),
            "vectors": (np.float32, (rows, sum(math.prod(box.shape) for box in boxes.values() if _is_vector(box)))),
            **{_PICTURE + name: (np.uint8, (rows, *box.shape)) for name, box in boxes.items() if not _is_vector(box)},
        }


@dataclass(slots=True)
class RowArrays:
    """Arrays of N rows.

    Attributes:
        actions: (N, ...) of the next step.
        expert_actions: (N, ...) of the expert, where `expert_known`.
        expert_known: (N,) whether the expert had an action when it was last asked.
        rewards: (N,) of the last step.
        terminations: (N,) whether the episode terminated in the last step.
        truncations: (N,) whether it was truncated.
        successes: (N,) whether the ended episode succeeded.
        measures: (N, M) measures of the ended episode.
        vectors: (N, F) all float32 observations, side by side.
        observations: (N, ...) by name; those of float32 are views of `vectors`.
    """

    actions: NDArray[Any]
    expert_actions: NDArray[Any]
    expert_known: BoolArray
    rewards: FloatArray
    terminations: BoolArray
    truncations: BoolArray
    successes: BoolArray
    measures: FloatArray
    vectors: Float32Array
    observations: Observations

    @classmethod
    def of(cls, arrays: Mapping[str, NDArray[Any]], space: Dict, rows: slice = slice(None)) -> RowArrays:
        """Some rows of the arrays of `RowPlan.layout`, for an observation space."""
        some = {name: array[rows] for name, array in arrays.items() if not name.startswith(_PICTURE)}
        observations, column = {}, 0
        for name, box in _boxes(space).items():
            if _is_vector(box):
                columns = slice(column, column + math.prod(box.shape))
                observations[name] = some["vectors"][:, columns].reshape(-1, *box.shape)
                column = columns.stop
            else:
                observations[name] = arrays[_PICTURE + name][rows]
        return cls(**some, observations=observations)


def _boxes(space: Dict) -> dict[str, Box]:
    return {name: box for name, box in space.items() if isinstance(box, Box)}


def _is_vector(box: Box) -> bool:
    return box.dtype == np.float32


def named_space(space: gymnasium.Space[Any]) -> Dict:
    """Observation space as Dict; a lone Box becomes `BARE`.

    Raises:
        InvalidInputError: It is no Box and no Dict of Box, or a Box holds neither float32 nor uint8.
    """
    named = space if isinstance(space, Dict) else Dict({BARE: space})
    for name, box in named.items():
        if not isinstance(box, Box) or box.dtype not in (np.float32, np.uint8):
            raise InvalidInputError(f"observation '{name}': expected a Box of float32 or uint8, got {box}")
    return named


def checked_actions(actions: ArrayLike, shape: tuple[int, ...], dtype: DTypeLike) -> NDArray[Any]:
    """Actions as an array of a shape and a type; numbers beyond the range of a type of floats become its limits.

    Raises:
        InvalidActionError: They have another shape, are complex, or are not finite.
    """
    floats = np.issubdtype(dtype, np.floating)
    try:
        given = np.asarray(actions)
        if given.dtype.kind == "c":  # NumPy would drop the imaginary parts
            raise InvalidActionError(f"expected real numbers, got {actions!r}"[:200])
        if given.dtype.kind not in "biuf":
            given = given.astype(np.float64 if floats else dtype)
    except (TypeError, ValueError, OverflowError) as error:  # also lists of different lengths
        raise InvalidActionError(f"expected an array of shape {shape}, got {actions!r}"[:200]) from error
    if given.shape != shape:
        raise InvalidActionError(f"expected actions of shape {shape}, got shape {given.shape}")
    if not np.isfinite(given).all():
        raise InvalidActionError(f"expected finite actions, got {given[~np.isfinite(given)][:4].tolist()}")
    if floats and given.dtype != dtype:
        given = given.clip(np.finfo(dtype).min, np.finfo(dtype).max)
    return given.astype(dtype, copy=False)


def row_seeds(seed: Any, count: int) -> list[int | None]:
    """One seed per row: as given, or s, s + 1, ... for a single s.

    Raises:
        InvalidInputError: There are more or fewer than `count`, or one is no seed.
    """
    if seed is None:
        return [None] * count
    if not isinstance(seed, Sequence | np.ndarray):
        first = checked_seed(seed)
        return [first + row for row in range(count)]
    if len(seed) != count:
        raise InvalidInputError(f"expected {count} seeds, got {len(seed)}")
    return [None if one is None else checked_seed(one) for one in seed]


def row_mask(rows: ArrayLike, count: int) -> BoolArray:
    """Mask of rows, (count,).

    Raises:
        InvalidInputError: It has another shape.
    """
    try:
        mask = np.asarray(rows, dtype=np.bool_)
    except ValueError as error:  # lists of different lengths
        raise InvalidInputError(f"expected a mask of shape {(count,)}, got {rows!r}"[:200]) from error
    if mask.shape != (count,):
        raise InvalidInputError(f"expected a mask of shape {(count,)}, got {mask.shape}")
    return mask


class EnvRows:
    """One environment, which reads its actions from its rows and writes its results there."""

    def __init__(self, plan: RowPlan, arrays: Mapping[str, NDArray[Any]], rank: int) -> None:
        self._plan, self._rank = plan, rank
        rows = slice(rank * plan.group_size, (rank + 1) * plan.group_size)
        self._rows = RowArrays.of(arrays, plan.observation_space, rows)
        self._discrete = isinstance(plan.action_space, Discrete)
        self._env: Any = None
        self._acting: set[int] = set()  # rows whose episode has not ended

    def carry_out(self, command: str, *arguments: Any) -> Any:
        """Calls one of the methods below.

        Raises:
            DohyoError: The environment's own; EnvError names the environment and the cause if its code failed.
        """
        try:
            return getattr(self, command)(*arguments)
        except DohyoError:
            raise
        except Exception as error:
            raise self._error(f"{type(error).__name__}: {error}") from error

    def reset(self, seed: int | None, options: dict[str, Any] | None) -> None:
        """Begins an episode.

        Raises:
            DohyoError: The environment's own; EnvError if its observations do not fit the space, or an agent is absent.
        """
        if self._env is None:
            env = self._plan.make_env(self._rank)
            self._env = OneAgentEnv(env) if isinstance(env, gymnasium.Env) else env
        observations, _ = self._env.reset(seed=seed, options=options)
        if absent := set(self._env.possible_agents) - set(self._env.agents):
            raise self._error(f"expected all agents to begin the episode, {sorted(map(str, absent))} did not")
        self._acting = set(range(self._plan.group_size))
        self._write_observations(observations)

    def step(self) -> None:
        """Takes one step with the agents whose episodes have not ended.

        Raises:
            DohyoError: The environment's own; EnvError if its results do not fit the spaces.
        """
        env = self._started
        actions = {agent: self._action(row) for row, agent in enumerate(env.possible_agents) if agent in env.agents}
        observations, rewards, terminations, truncations, infos = env.step(actions)
        for row in list(self._acting):
            agent = env.possible_agents[row]
            self._write_outcome(row, rewards[agent], terminations[agent], truncations[agent], infos[agent])
            if row in self._acting and agent not in env.agents:
                raise self._error(f"agent '{agent}' has left, but its episode neither terminated nor was truncated")
        self._write_observations(observations)

    def ask_expert(self) -> None:
        """Writes the expert's action for the present observation of each agent whose episode has not ended."""
        env, rows = self._started, self._rows
        rows.expert_known[:] = False
        for row, agent in enumerate(env.possible_agents):
            action = env.expert_action(agent) if agent in env.agents else None
            if action is None:
                continue
            if np.shape(action) != rows.expert_actions.shape[1:] or not np.isfinite(action).all():
                raise self._error(f"expected an expert's action in {self._plan.action_space}, got {action}")
            rows.expert_actions[row] = action
            rows.expert_known[row] = True

    def render(self) -> Any:
        """The environment's picture."""
        return self._started.render()

    def close(self) -> None:
        """Closes the environment, which may fail at that; the next reset makes a new one."""
        env, self._env = self._env, None
        try:
            if env is not None:
                env.close()
        except (Exception, SystemExit) as error:
            logger.warning("environment %d could not be closed: %s: %s", self._rank, type(error).__name__, error)

    @property
    def _started(self) -> Any:
        if self._env is None:
            raise SimulationError(f"environment {self._rank} has not been reset")
        return self._env

    def _action(self, row: int) -> Any:
        """Action of a row, as a copy: the environment may keep it."""
        actions = self._rows.actions
        return int(actions[row]) if self._discrete else actions[row].copy()

    def _write_observations(self, observations: Mapping[Any, Any]) -> None:
        expected = self._rows.observations
        for row, agent in enumerate(self._env.possible_agents):
            if agent not in observations:
                continue
            named = observations[agent]
            if not isinstance(named, Mapping):
                named = {BARE: named}
            if named.keys() != expected.keys():
                raise self._error(f"expected observations {[*expected]}, got {[*named]}")
            for name, array in expected.items():
                value, target = named[name], array[row]
                if not isinstance(value, np.ndarray) or value.shape != target.shape or value.dtype != target.dtype:
                    value = self._converted(name, value, target)
                array[row] = value
        if not np.isfinite(self._rows.vectors).all():
            name, array = next((name, array) for name, array in expected.items() if not np.isfinite(array).all())
            where = np.argwhere(~np.isfinite(array))[:4, 1:].tolist()
            raise self._error(f"expected finite observations, got others in '{name}' at {where}")

    def _converted(self, name: str, value: Any, target: NDArray[Any]) -> NDArray[Any]:
        """An observation with the type of its space, if it has the shape and numpy allows the cast."""
        array = np.asarray(value)
        if array.shape != target.shape:
            raise self._error(f"observation '{name}': expected shape {target.shape}, got {array.shape}")
        if not np.can_cast(array.dtype, target.dtype, "same_kind"):
            raise self._error(f"observation '{name}': expected {target.dtype}, got {array.dtype}")
        return array.astype(target.dtype)

    def _write_outcome(self, row: int, reward: Any, terminated: Any, truncated: Any, info: Mapping[str, Any]) -> None:
        rows, number = self._rows, _number(reward)
        if not abs(number) <= LARGEST_REWARD:
            raise self._error(
                f"expected as reward one finite number, of {LARGEST_REWARD:.0e} at most, got {str(reward)[:100]}"
            )
        rows.rewards[row], rows.terminations[row], rows.truncations[row] = number, terminated, truncated
        if terminated or truncated:
            self._acting.remove(row)
            self._write_end(row, info)

    def _write_end(self, row: int, info: Mapping[str, Any]) -> None:
        if missing := [name for name in self._plan.measures if name not in info]:
            raise self._error(f"the last info of an episode lacks {', '.join(missing)}")
        success = info.get("success", False)
        if _number(success) not in (0.0, 1.0):
            raise self._error(f"expected as success true, false, 0 or 1, got {str(success)[:100]!r}")
        self._rows.successes[row] = bool(_number(success))
        self._rows.measures[row] = [float(info[name]) for name in self._plan.measures]

    def _error(self, what: str) -> EnvError:
        return EnvError(f"environment {self._rank}: {what}")


def _number(value: Any) -> float:
    """A number or truth value, also as an array of one; NaN for anything else, such as text."""
    if isinstance(value, str | bytes):
        return math.nan
    try:
        return float(value)
    except (TypeError, ValueError):
        pass
    try:
        array = np.asarray(value)
    except (TypeError, ValueError):  # lists of different lengths
        return math.nan
    return float(array.item()) if array.size == 1 and array.dtype.kind in "biuf" else math.nan


class OneAgentEnv:
    """A gymnasium environment in the form of PettingZoo's ParallelEnv, with one agent."""

    possible_agents = (0,)

    def __init__(self, env: gymnasium.Env[Any, Any]) -> None:
        self._env = env
        self.agents: tuple[int, ...] = ()
        self.render, self.close = env.render, env.close

    def reset(self, seed: int | None, options: dict[str, Any] | None) -> tuple[dict[int, Any], dict[int, Any]]:
        """See `gymnasium.Env.reset`."""
        observation, info = self._env.reset(seed=seed, options=options)
        self.agents = self.possible_agents
        return {0: observation}, {0: info}

    def step(self, actions: Mapping[int, Any]) -> tuple[dict[int, Any], ...]:
        """See `gymnasium.Env.step`."""
        observation, reward, terminated, truncated, info = self._env.step(actions[0])
        if terminated or truncated:
            self.agents = ()
        return {0: observation}, {0: reward}, {0: terminated}, {0: truncated}, {0: info}

    def expert_action(self, agent: int) -> Any:
        """The expert's action, from the environment's `expert_action()`."""
        return self._env.get_wrapper_attr("expert_action")()
