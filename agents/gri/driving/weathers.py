"""WeathersTask: the driving task under NoCrash's four conditions of training, dealt out to the missions in turn.

`DrivingTask` is always clear, which tells nothing apart where the exact state is seen; what is learned from pictures
of clear days alone drives nowhere else.
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

WEATHERS: Final = "-weathers"
"""End of the task's name."""


@dataclass(frozen=True)
class WeathersTask(DrivingTask):
    """Missions from seeds, see `draw_in_weather`."""

    @property
    def name(self) -> str:
        """See `Task`."""
        return super().name + WEATHERS

    def make_env(self, rank: int) -> Env:
        """See `Task`."""
        return WeathersEnv(self)


class WeathersEnv(MissionEnv):
    """See `WeathersTask`."""

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Array], dict[str, Any]]:
        """Begins the mission of a seed."""
        self.close()
        sensors = dict.fromkeys((*self._sight.sensors, *Autopilot.spec.sensors))
        scenario = draw_in_weather(seed or 0)
        self._driving = DrivingEnv(scenario, tuple(sensors), CONTROL, reward=None)
        observations, _ = self._driving.reset()
        self._seen = observations[EGO]
        self._reward, self._advised = GriadReward(), False
        self._sight.reset(scenario.missions[0], scenario.seed)
        return self._sight.encode(self._seen), {}


def draw_in_weather(seed: int) -> Scenario:
    """The scenario of an episode: that of `draw_mission` under the conditions whose turn it is.

    Raises:
        InvalidInputError: See `draw_mission`.
    """
    return draw_mission(seed).model_copy(update={"conditions": tuple(TRAIN)[seed % len(TRAIN)]})
