"""Any gymnasium environment as a task, for checks of the algorithms and for users' own environments.

dohyo train gymnasium --set env=Pendulum-v1 --set algorithm=sac --set sac.batch=128
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import Annotated, Any, Literal

import gymnasium
from gymnasium.spaces import Box, Dict, Discrete
from pydantic import Field

from dohyo.agents.learning.algorithms.ddpg import Ddpg, DdpgConfig
from dohyo.agents.learning.algorithms.iqn import Iqn, IqnConfig
from dohyo.agents.learning.algorithms.off_policy import make_replay
from dohyo.agents.learning.algorithms.ppo import Ppo, ppo_actor
from dohyo.agents.learning.algorithms.ppo_config import PpoConfig
from dohyo.agents.learning.algorithms.sac import Sac, SacConfig
from dohyo.agents.learning.experience.collector import Collector
from dohyo.agents.learning.experience.explorers import Explorers
from dohyo.agents.learning.gymnasium.spaces import in_our_form
from dohyo.agents.learning.networks.modules import ObservationEncoder
from dohyo.agents.learning.runs.config import Positive
from dohyo.agents.learning.runs.off_policy_config import OffPolicyRunConfig
from dohyo.agents.learning.runs.run import TaskRun
from dohyo.agents.learning.runs.trainer import Trainer, TrainRequest
from dohyo.agents.learning.runs.training import Learner, train_off_policy, train_task
from dohyo.agents.learning.tasks.task import Env, Environments, Task, check_task, named
from dohyo.sumo_networks.envs.single_env import SingleDrivingEnv
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.seeds import HELD_OUT_FROM

logger = logging.getLogger(__name__)

REMOTE = "dohyo/Remote-v0"
OFF_POLICY: dict[str, type[Sac | Ddpg | Iqn]] = {"sac": Sac, "ddpg": Ddpg, "iqn": Iqn}


class GymnasiumConfig(OffPolicyRunConfig):
    """A run on a gymnasium environment.

    Attributes:
        env: Name in gymnasium's registry, "module:NAME" of one that the module registers, or the address of a service
            whose worlds are driven, such as "http://127.0.0.1:8000?benchmark=quickstart".
        algorithm: What learns; its settings are the table of that name.
        longest: Steps after which an episode is cut off, for an environment without a limit; 0: as it says itself.
        episodes: Held-out episodes.
        ppo: Settings of PPO.
        sac: Settings of SAC.
        ddpg: Settings of DDPG.
        iqn: Settings of IQN.
    """

    env: str = "Pendulum-v1"
    algorithm: Literal["ppo", "sac", "ddpg", "iqn"] = "sac"
    processes: Annotated[int, Field(ge=0, le=64)] = 0
    longest: Annotated[int, Field(ge=0)] = 0
    episodes: Positive = 20
    ppo: PpoConfig = PpoConfig()
    sac: SacConfig = SacConfig()
    ddpg: DdpgConfig = DdpgConfig()
    iqn: IqnConfig = IqnConfig()


@dataclass(frozen=True)
class _Facts:
    """What one environment of a task tells of all."""

    spaces: tuple[Any, Any]  # of observations and of actions
    alone: bool = False
    ends: bool = True


@dataclass(frozen=True)
class GymnasiumTask(Task):
    """A gymnasium environment, in the form of `in_our_form`.

    Attributes:
        env: Name in gymnasium's registry, or the address of a service.
        episodes: Number of held-out episodes.
        first: Seed of the first of them.
        longest: See `GymnasiumConfig`.
    """

    env: str
    episodes: int = 20
    first: int = HELD_OUT_FROM
    longest: int = 0

    @property
    def name(self) -> str:
        """See `Task`."""
        return self.env

    @property
    def held_out(self) -> Sequence[int]:
        """See `Task`."""
        return range(self.first, self.first + self.episodes)

    @property
    def remote(self) -> bool:
        """Whether the environments are worlds of a service."""
        return self.env.startswith(("http://", "https://"))

    @cached_property
    def _facts(self) -> _Facts:
        if self.remote:
            with closing(self.make_environments(1, processes=False)) as envs:
                return _Facts((envs.single_observation_space, envs.single_action_space))
        with closing(self.make_env(0)) as env:
            ends = self.longest > 0 or env.spec is None or env.spec.max_episode_steps is not None
            alone = isinstance(env.unwrapped, SingleDrivingEnv)
            return _Facts((env.observation_space, env.action_space), alone, ends)

    @property
    def observation_space(self) -> Dict:
        """See `Task`."""
        space: Dict = self._facts.spaces[0]
        return space

    @property
    def action_space(self) -> Box | Discrete:
        """See `Task`."""
        space: Box | Discrete = self._facts.spaces[1]
        return space

    @property
    def alone(self) -> bool:
        """See `Task`; so is an environment of dohyo, whatever wraps it."""
        return not self.remote and self._facts.alone

    @property
    def ends(self) -> bool:
        """Whether an episode has a limit of steps, as far as is known."""
        return self.remote or self._facts.ends

    def make_env(self, rank: int) -> Env:
        """See `Task`.

        Raises:
            InvalidInputError: It cannot be made, or its observations cannot be used; see `in_our_form`.
        """
        try:
            env = gymnasium.make(self.env, max_episode_steps=self.longest or None)
        except Exception as error:  # of the registry, or of the environment's own code
            raise InvalidInputError(f"environment '{self.env}': {type(error).__name__}: {error}") from error
        return in_our_form(env, self.env)

    def make_environments(self, count: int, processes: bool) -> Environments:
        """See `Task`. Worlds of a service have processes of their own there."""
        if not self.remote:
            return super().make_environments(count, processes)
        return gymnasium.make_vec(REMOTE, num_envs=count, vectorization_mode="vector_entry_point", url=self.env)


def make_ppo(task: Task, settings: GymnasiumConfig, collector: Collector, run: TaskRun) -> Learner:
    """Learner by PPO."""
    return Ppo(task, collector, settings.ppo, run.device, settings.seed)


def make_off_policy(
    task: Task, settings: GymnasiumConfig, collector: Collector | Explorers, run: TaskRun
) -> Sac | Ddpg | Iqn:
    """Learner of the off-policy algorithm that the settings name."""
    config = getattr(settings, settings.algorithm)
    replay = make_replay(task, run, config, rows=len(collector))
    return OFF_POLICY[settings.algorithm](task, collector, replay, config, run.device)


def check_fit(task: Task, settings: GymnasiumConfig) -> None:
    """Raises InvalidInputError if the algorithm cannot learn the task, before a run is begun."""
    check_task(task)
    encoder = ObservationEncoder(named(task.observation_space))
    if settings.algorithm == "ppo":
        if settings.explorers or settings.cluster:
            raise InvalidInputError(
                "ppo learns from its own policy's steps alone: expected explorers = 0 and no cluster"
            )
        ppo_actor(encoder.features, task.action_space, settings.ppo)
    else:
        OFF_POLICY[settings.algorithm].check(task)


def _train(settings: GymnasiumConfig, request: TrainRequest) -> Path:
    task = GymnasiumTask(settings.env, settings.episodes, longest=settings.longest)
    check_fit(task, settings)
    if not task.ends:
        logger.warning("environment '%s' has no limit of steps: 'longest' gives it one, or episodes may never end",
                       settings.env)  # fmt: skip
    if settings.algorithm == "ppo":
        return train_task(partial(make_ppo, task, settings), task, settings, request)
    return train_off_policy(partial(make_off_policy, task, settings), task, settings, request)


GYMNASIUM = Trainer("any gymnasium environment, by PPO, SAC, DDPG or IQN", GymnasiumConfig, _train)
