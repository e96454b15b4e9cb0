"""Curriculum of parking: a way to a free spot, then between obstacles, then aligned (Albilani 2023, figure 5.3).

The thesis promotes when "the agent manages to double its accumulated reward for four million episodes", which cannot be
meant literally: from -1 nothing doubles, and its trainings have 60 million steps. Ours: the reward of an episode is +1
or -1, so its rate of successes is what can double. A learner is promoted when this rate is twice that of the level's
first window, but at least 0.7, since from nearly nothing anything doubles, and 0.8 suffices, since a learner explores.
"""

from __future__ import annotations

from dataclasses import dataclass

from dohyo.agents.learning.tasks.curriculum import Curriculum
from dohyo.sumo_networks.parking.generate import Scene
from dohyo.sumo_networks.parking.rules import Rules
from dohyo.sumo_networks.parking.vector_env import Level

WINDOW = 500
LEAST, ENOUGH = 0.7, 0.8


@dataclass(frozen=True, slots=True)
class Doubling(Curriculum):
    """Promotes at twice the success rate of a level's first window, within `LEAST` and `ENOUGH`."""

    window: int = WINDOW

    def wanted(self, first: float) -> float:
        """See `Curriculum`."""
        return min(max(2.0 * first, LEAST), ENOUGH)


def tasks(scene: Scene, rules: Rules) -> tuple[Level, ...]:
    """T1 to T3, of which the last one is a scene with its rules.

    T1: no obstacles, any heading in the spot. T2: the scene, any heading. T3: everything.
    """
    unaligned = rules.model_copy(update={"wheel_degrees": None, "error_degrees": None, "alignment": 0.0})
    return Level(Scene.SIMPLE, unaligned), Level(scene, unaligned), Level(scene, rules)
