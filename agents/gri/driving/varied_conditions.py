"""VariedConditionsTask: the driving task under NoCrash's four conditions of training, dealt out to missions in turn.

`DrivingTask` is always clear. What has learned from pictures of clear days alone stands in rain.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

from dohyo.agents.experts.autopilot import Autopilot
from dohyo.agents.gri.driving.choices import CONTROL
from dohyo.agents.gri.driving.missions import draw_mission
from dohyo.agents.gri.driving.reward import GriadReward
from dohyo.agents.gri.driving.task import EGO, DrivingTask, MissionEnv
from dohyo.agents.learning.tasks.task import Array, Env
from dohyo.sumo_networks.conditions import TRAIN
from dohyo.sumo_networks.envs.driving_env import DrivingEnv
from dohyo.sumo_networks.scenario import Scenario

VARIED: Final = "-varied"
"""End of the task's name."""


@dataclass(frozen=True)
class VariedConditionsTask(DrivingTask):
    """Missions from seeds, see `draw_varied`."""

    @property
    def name(self) -> str:
        """See `Task`."""
        return super().name + VARIED

    def make_env(self, rank: int) -> Env:
        """See `Task`."""
        return VariedConditionsEnv(self)


class VariedConditionsEnv(MissionEnv):
    """See `VariedConditionsTask`."""

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Array], dict[str, Any]]:
        """Begins the mission of a seed."""
        # As in `MissionEnv`, whose file is one of the shipped agent's sources and so waits for the next edition.
        self.close()
        sensors = dict.fromkeys((*self._sight.sensors, *Autopilot.spec.sensors))
        scenario = draw_varied(seed or 0)
        self._driving = DrivingEnv(scenario, tuple(sensors), CONTROL, reward=None)
        observations, _ = self._driving.reset()
        self._seen = observations[EGO]
        self._reward, self._advised = GriadReward(), False
        self._sight.reset(scenario.missions[0], scenario.seed)
        return self._sight.encode(self._seen), {}


def draw_varied(seed: int) -> Scenario:
    """The scenario of an episode: that of `draw_mission` under the conditions whose turn it is.

    Raises:
        InvalidInputError: See `draw_mission`.
    """
    return draw_mission(seed).model_copy(update={"conditions": tuple(TRAIN)[seed % len(TRAIN)]})
