"""Task: the interface of a learning problem. A learner sees nothing else of it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import gymnasium
from gymnasium.spaces import Box
from numpy.typing import NDArray

from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.seeds import HELD_OUT_FROM

Array = NDArray[Any]
Env = gymnasium.Env[Array, Array]


class Task(Protocol):
    """Learning problem. Derive from it as a frozen dataclass, since it is sent to other processes.

    Two obligations follow from exact resumption. An episode follows from the seed given to `reset` and the actions
    given to `step`, and from nothing else: no wall clock, no state of an earlier episode. And `expert` is a
    function of the episode so far.

    At the end of an episode `info` may hold "success" (bool, default False), and must hold each of `measures`.
    """

    @property
    def name(self) -> str:
        """Name of the results."""

    @property
    def observation_space(self) -> Box:
        """Space of one observation; PPO needs a float32 vector of about unit scale."""

    @property
    def action_space(self) -> Box:
        """Space of one action, with finite bounds. Actions of learners in [-1, 1] are scaled to them and clipped."""

    @property
    def held_out(self) -> Sequence[int]:
        """Seeds of the episodes that a policy is judged on; all in [HELD_OUT_FROM, 2^31)."""

    @property
    def measures(self) -> tuple[str, ...]:
        """Names of floats in an episode's last `info` besides "success"; evaluations report their means."""
        return ()

    @property
    def alone(self) -> bool:
        """Whether a process can hold only one of its environments, as with SUMO."""
        return False

    def make_env(self, seed: int, rank: int) -> Env:
        """An environment, not started yet; there may be one that uses SUMO per process.

        Args:
            seed: Of the run. An episode must not depend on it.
            rank: Index of the environment in the run, from 0; the last one is for held-out episodes.
        """

    def expert(self, env: Env) -> Array | None:
        """Expert's action, in the action space; None: it has none, and the policy acts.

        Asked once after `reset` and once after every step of an episode that the expert drives, in the environment's
        own process, where `env` may be narrowed to what `make_env` made.
        """
        return None


def held_out_seeds(count: int) -> range:
    """First held-out seeds."""
    return range(HELD_OUT_FROM, HELD_OUT_FROM + count)


def check_task(task: Task) -> None:
    """Raises InvalidInputError if a task's spaces or seeds cannot be used."""
    low, high = task.action_space.low, task.action_space.high
    if not task.action_space.is_bounded() or not (low < high).all():
        raise InvalidInputError(f"task '{task.name}': expected actions with finite bounds, got {low} to {high}")
    if trained_on := [seed for seed in task.held_out if not HELD_OUT_FROM <= seed < 2**31]:
        raise InvalidInputError(
            f"task '{task.name}': expected held-out seeds in [{HELD_OUT_FROM}, {2**31}), got {trained_on[0]}"
        )
    if not task.held_out:
        raise InvalidInputError(f"task '{task.name}': expected at least one held-out seed")
