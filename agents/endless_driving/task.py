"""Task of RLAD and RLfOLD: Roach's reward, 5 decisions per second, endless goals; judged on missions of their own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from gymnasium.spaces import Box, Dict

from dohyo.agents.endless_driving.config import ExpertConfig, TownConfig
from dohyo.agents.endless_driving.environment import LIGHT, MEASURES, EndlessDrivingEnv
from dohyo.agents.endless_driving.observation import make_view
from dohyo.agents.learning.tasks.environments import FrameStack
from dohyo.agents.learning.tasks.task import Env, Environments, Task, held_out_seeds


@dataclass(frozen=True)
class EndlessDriving(Task):
    """The learning problem.

    Attributes:
        town: Its settings.
        expert: Who gives labels; None: nobody.
    """

    town: TownConfig
    expert: ExpertConfig | None = None

    @property
    def name(self) -> str:
        """See `Task`."""
        return f"endless-driving-{self.town.roads}"

    @cached_property
    def observation_space(self) -> Dict:
        """Stacked pictures or the state, waypoints and measurements, and the light's class for losses."""
        spaces = dict(self.single_space.spaces)
        for name, space in self.single_space.spaces.items():
            if isinstance(space, Box) and len(space.shape) == 3:
                low, high = (np.tile(bound, (self.town.frames, 1, 1)) for bound in (space.low, space.high))
                spaces[name] = Box(low, high, dtype=np.uint8)
        return Dict(spaces)

    @cached_property
    def single_space(self) -> Dict:
        """The observation of one tick, with a single picture."""
        town = self.town
        view = make_view(town.view, town.max_speed, town.history, town.side)
        return Dict({**view.space.spaces, LIGHT: Box(0.0, 2.0, (1,), np.float32)})

    @cached_property
    def action_space(self) -> Box:
        """Target speed and steering, see `observation.TargetSpeed`."""
        return Box(-1.0, 1.0, (2,), np.float32)

    @property
    def held_out(self) -> Sequence[int]:
        """See `Task`."""
        return held_out_seeds(1 if self.town.roads == "one-route" else self.town.held_out)

    @property
    def measures(self) -> tuple[str, ...]:
        """See `environment.MEASURES`."""
        return MEASURES

    @property
    def has_expert(self) -> bool:
        """Whether there is one."""
        return self.expert is not None

    @property
    def alone(self) -> bool:
        """See `Task`."""
        return True

    def make_env(self, rank: int) -> Env:
        """See `Task`."""
        return EndlessDrivingEnv(self)

    def make_environments(self, count: int, processes: bool) -> Environments:
        """See `Task`; pictures are stacked."""
        made: Any = _SingleFrames(self.town, self.expert).of_ticks(count, processes)
        return FrameStack(made, self.town.frames) if self.town.view == "picture" else made


class _SingleFrames(EndlessDriving):
    """The same task with single pictures, as its environments have them."""

    @cached_property
    def observation_space(self) -> Dict:
        """See `single_space`."""
        return self.single_space

    def of_ticks(self, count: int, processes: bool) -> Environments:
        """Environments without a stack."""
        return Task.make_environments(self, count, processes)
