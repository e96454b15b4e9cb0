"""Parking as a task of the learning floor: scenes, rewards, held-out lots."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal

from gymnasium.spaces import Box

from dohyo.agents.learning.tasks.curriculum import Curriculum
from dohyo.agents.learning.tasks.task import Environments, Task
from dohyo.agents.parking.training.curriculum import Doubling, tasks
from dohyo.agents.parking.training.guided import GuidedVectorEnv, forward_actions
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.parking.generate import Scene
from dohyo.sumo_networks.parking.observation import observation_space
from dohyo.sumo_networks.parking.rules import ALIGNED, SIMPLE, WITHOUT_ALIGNMENT, WITHOUT_DWELL, Rules
from dohyo.sumo_networks.parking.vector_env import MEASURES, Level
from dohyo.sumo_networks.seeds import HELD_OUT_FROM

FIRST_LOT: Final = HELD_OUT_FROM + 1_000_000
"""First lot of the evaluations that choose the best policy of a training; the benchmarks' lots are below."""
SceneName = Literal["simple", "complex"]
Reward = Literal["simple", "graded", "aligned", "without-dwell", "without-alignment"]
REWARDS: dict[Reward, Rules] = {
    "simple": SIMPLE,
    "graded": ALIGNED.model_copy(update={"standing": True, "alignment": 1.0}),
    "aligned": ALIGNED.model_copy(update={"standing": True}),
    "without-dwell": WITHOUT_DWELL,
    "without-alignment": WITHOUT_ALIGNMENT.model_copy(update={"standing": True}),
}
"""Rewards by name; those of the thesis are where a parked kart also stands if there is a dwell, as the judge demands
(ours). The thesis reports that a higher penalty of bad alignment helped, and has no number of it; "graded", which is
ours, adds up to 1 for a parked kart, the better it is aligned."""


@dataclass(frozen=True)
class ParkingTask(Task):
    """Karts that park; only scenes that may be trained on.

    Attributes:
        scene: Kind of lot.
        reward: See `REWARDS`.
        progress: Reward per metre towards the spot, see `Rules`.
        karts: In each lot.
        gradual: Whether there is a curriculum.
        lots: Number of held-out lots.
        disturbance: See `GuidedVectorEnv`; for demonstrations.
    """

    scene: SceneName = "complex"
    reward: Reward = "aligned"
    progress: float = 0.0
    karts: int = 1
    gradual: bool = False
    lots: int = 256
    disturbance: float = 0.0

    measures = MEASURES
    has_expert = True

    @property
    def name(self) -> str:
        """See `Task`."""
        return f"parking-{self.scene}-{self.karts}"

    @property
    def observation_space(self) -> Box:
        """See `Task`."""
        return observation_space()

    @property
    def action_space(self) -> Box:
        """See `Task`."""
        return forward_actions()

    @property
    def held_out(self) -> Sequence[int]:
        """See `Task`; all karts of a lot share its seed."""
        return [FIRST_LOT + lot for lot in range(self.lots) for _ in range(self.karts)]

    @property
    def judged_at_once(self) -> int:
        """See `Task`."""
        return self.lots * self.karts

    @property
    def curriculum(self) -> Curriculum | None:
        """See `Task`."""
        return Doubling(len(self.levels)) if self.gradual else None

    @property
    def levels(self) -> tuple[Level, ...]:
        """Levels of the curriculum, or the only one."""
        rules = REWARDS[self.reward].model_copy(update={"progress": self.progress})
        scene = Scene[self.scene.upper()]
        return tasks(scene, rules) if self.gradual else (Level(scene, rules),)

    def make_environments(self, count: int, processes: bool) -> Environments:
        """See `Task`; all lots are in this process."""
        if processes:
            raise InvalidInputError(f"task '{self.name}': expected processes = 0, since one process holds all lots")
        if count % self.karts:
            raise InvalidInputError(
                f"task '{self.name}': expected environments that are a multiple of {self.karts} karts, got {count}"
            )
        return GuidedVectorEnv(count // self.karts, self.levels, self.karts, self.disturbance)
