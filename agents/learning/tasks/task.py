"""Task: the interface of a learning problem. A learner sees nothing else of it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import gymnasium
import numpy as np
from gymnasium.spaces import Box, Dict, Discrete
from gymnasium.vector import VectorEnv
from numpy.typing import NDArray

from dohyo.agents.learning.tasks.curriculum import Curriculum
from dohyo.sumo_networks.envs.local_vector_env import LocalVectorEnv
from dohyo.sumo_networks.envs.process_vector_env import ProcessVectorEnv
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.seeds import HELD_OUT_FROM

Array = NDArray[Any]
Env = gymnasium.Env[Any, Any]
Environments = VectorEnv[dict[str, Array], Array, Array]

SINGLE = "observation"
"""Key of the observation of a task that has only one."""
ACTION = "action"
"""Name of an exported policy's output, which no observation can have."""


class Task(Protocol):
    """Learning problem. Derive from it as a frozen dataclass, since it is sent to other processes.

    Exact resumption needs that an episode follows from the seed and level given to `reset` and the actions given to
    `step`, and from nothing else: no wall clock, no state of an earlier episode.

    A task of one environment at a time implements `make_env`; a world that advances many environments at once
    implements `make_environments`. At the end of an episode `info` may hold "success" (bool, default False), and must
    hold each of `measures`.
    """

    @property
    def name(self) -> str:
        """Name of the results."""

    @property
    def observation_space(self) -> Box | Dict:
        """Space of one observation: float32 vectors (O,) or uint8 pictures (C, H, W), by name, or a single one."""

    @property
    def action_space(self) -> Box | Discrete:
        """Space of one action: a float32 vector with finite bounds, or a number of choices."""

    @property
    def held_out(self) -> Sequence[int]:
        """Seeds of the episodes that a policy is judged on; all in [HELD_OUT_FROM, 2^31)."""

    @property
    def measures(self) -> tuple[str, ...]:
        """Names of floats in an episode's last `info` besides "success"; evaluations report their means."""
        return ()

    @property
    def curriculum(self) -> Curriculum | None:
        """Levels of difficulty, given to `reset` as `options["level"]`; None: there is one."""
        return None

    @property
    def has_expert(self) -> bool:
        """Whether its environments have an expert."""
        return False

    @property
    def alone(self) -> bool:
        """Whether a process can hold only one of its environments, as with SUMO."""
        return False

    @property
    def judged_at_once(self) -> int:
        """Environments that drive the held-out episodes together."""
        return 1

    def make_env(self, rank: int) -> Env:
        """An environment, not started yet; called in the environment's own process.

        An expert is a method `expert_action() -> action | None` of it (None: no opinion), asked for the present
        observation at most once.

        Args:
            rank: Index of the environment, from 0.

        Raises:
            InvalidInputError: The task implements only `make_environments`.
        """
        raise InvalidInputError(f"task '{self.name}' makes no single environments: expected `make_environments`")

    def make_environments(self, count: int, processes: bool) -> Environments:
        """Environments that step together, see `environments.check_environments`.

        Args:
            count: Number of environments.
            processes: One process each; otherwise all are in this process.
        """
        kind = ProcessVectorEnv if processes else LocalVectorEnv
        return kind(
            make_env=self.make_env,
            num_envs=count,
            observation_space=named(self.observation_space),
            action_space=self.action_space,
            measures=self.measures,
            expert=self.has_expert,
        )


def named(space: Box | Dict) -> Dict:
    """The space as one of named observations."""
    return space if isinstance(space, Dict) else Dict({SINGLE: space})


def held_out_seeds(count: int) -> range:
    """First held-out seeds."""
    return range(HELD_OUT_FROM, HELD_OUT_FROM + count)


def check_task(task: Task) -> None:
    """Raises InvalidInputError if a task's spaces or seeds cannot be used."""
    check_spaces(f"task '{task.name}'", named(task.observation_space), task.action_space)
    if trained_on := [seed for seed in task.held_out if not HELD_OUT_FROM <= seed < 2**31]:
        raise InvalidInputError(
            f"task '{task.name}': expected held-out seeds in [{HELD_OUT_FROM}, {2**31}), got {trained_on[0]}"
        )
    if not task.held_out:
        raise InvalidInputError(f"task '{task.name}': expected at least one held-out seed")


def check_spaces(what: str, observations: gymnasium.Space[Any], actions: gymnasium.Space[Any]) -> None:
    """Raises InvalidInputError if no learner can use the spaces of an environment or a task.

    Args:
        what: Its name, for the error.
        observations: Of one environment.
        actions: Of one environment.
    """
    if not isinstance(observations, Dict) or not observations.spaces:
        raise InvalidInputError(f"{what}: expected named observations (a Dict space), got {observations}")
    if ACTION in observations.spaces:
        raise InvalidInputError(f"{what}: expected no observation named as a policy's output, got '{ACTION}'")
    for name, space in observations.spaces.items():
        vector = isinstance(space, Box) and space.dtype == np.float32 and len(space.shape) == 1
        picture = isinstance(space, Box) and space.dtype == np.uint8 and len(space.shape) == 3
        if not (vector or picture):
            got = f"{space.dtype} {space.shape}" if isinstance(space, Box) else str(space)
            raise InvalidInputError(
                f"{what}: expected observation '{name}' to be a vector of float32 or a picture (C, H, W) of uint8, "
                f"got {got}"
            )
    if isinstance(actions, Discrete) and actions.start == 0:
        return
    if not isinstance(actions, Box) or actions.dtype != np.float32 or len(actions.shape) != 1:
        raise InvalidInputError(f"{what}: expected actions to be a vector of float32 or Discrete from 0, got {actions}")
    if not actions.is_bounded() or not (actions.low < actions.high).all():
        raise InvalidInputError(
            f"{what}: expected actions with finite bounds, each low one below its high one, got {actions.low} to "
            f"{actions.high}"
        )
