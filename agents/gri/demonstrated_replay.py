"""GRI (Chekroun et al. 2021): whole demonstrations with one constant reward, in the replay of any off-policy learner.

Before an episode of the explorers is stored, a demonstration goes in with probability p_demo, again and again until a
draw fails. The learner has one loss and does not know which transitions were demonstrated. There is no imitation loss,
batches are not composed, and the rewards of the demonstrations are not used.

Source: Chekroun 2024, section 4.2 and algorithm 1.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field
from tensordict import TensorDictBase

from dohyo.agents.learning.experience.demonstrations import Demonstrations
from dohyo.agents.learning.experience.replay import Replay
from dohyo.agents.learning.runs.config import Positive, Share
from dohyo.sumo_networks.arrays import IntArray
from dohyo.sumo_networks.config import Config
from dohyo.sumo_networks.errors import InvalidInputError

_DRAWN = 2  # separates this random stream from those of seeds and mixtures


class GriConfig(Config):
    """Settings of GRI.

    Attributes:
        p_demo: Share of demonstrations; 0: the algorithm alone; 1: nothing of the explorers is stored.
        unit: What p_demo is a share of. "episodes" is algorithm 1. "steps" is GRIAD, whose demonstrators send as many
            steps as its explorers: a demonstration goes in whenever their share of all steps is below p_demo.
        demo_reward: r_demo, the reward of every demonstrated step; None: the highest that the expert reached.
        demo_noise: Share of bad ones among demonstrations that are recorded, see `experts`.
        explorer_reward: Reward of every explored step; None: the environment's. With 0, and a `demo_reward` of 1, it is
            SQIL (Reddy et al. 2020).
        shortest: Least mean length of the explorers' episodes that the replay has room for with "episodes", steps.
    """

    p_demo: Share = 0.2
    unit: Literal["episodes", "steps"] = "episodes"
    demo_reward: float | None = None
    demo_noise: Annotated[float, Field(ge=0, lt=1)] = 0.0
    explorer_reward: float | None = None
    shortest: Positive = 20


class DemonstratedReplay(Replay):
    """A replay with a demonstrator beside the explorers."""

    def __init__(self, *given: Any, shown: Demonstrations, gri: GriConfig, seed: int, **options: Any) -> None:
        """Prepares.

        Args:
            given: See `Replay`.
            shown: Demonstrations, of the same spaces.
            gri: Settings.
            seed: Of the run; it also decides which demonstrations go in when.
            options: See `Replay`.

        Raises:
            InvalidInputError: Explored steps are rewarded as much as demonstrated ones, so that nothing can be learned.
        """
        self._reward = shown.highest_reward if gri.demo_reward is None else gri.demo_reward
        if gri.explorer_reward is not None and gri.explorer_reward >= self._reward:
            raise InvalidInputError(
                f"gri.explorer_reward: expected less than the reward of demonstrations, {self._reward + 0.0:g}, got "
                f"{gri.explorer_reward:g}; give gri.demo_reward"
            )
        super().__init__(*given, seed=seed, **options)
        self._shown, self._gri, self._seed = shown, gri, seed
        self._begun: IntArray = np.zeros(0, np.int64)  # (N,) every row's last episode
        self._explored, self._demonstrated = 0, 0  # steps

    def add(self, step: TensorDictBase) -> None:
        """Adds a step of the explorers behind the demonstrations that are due; see `Replay.add`."""
        active, episodes = step["active"].numpy(), step["episode"].numpy()
        if not len(self._begun):
            self._begun = np.full(len(episodes), -1)
        beginning = active & (self._begun != episodes)
        self._begun = np.where(active, episodes, self._begun)
        self._explored += int(np.count_nonzero(active))
        for row in np.flatnonzero(beginning).tolist():
            self._before_episode(np.random.default_rng([_DRAWN, self._seed, int(episodes[row]), row]))
        if self._gri.unit == "steps":
            self._catch_up()
        if self._gri.p_demo < 1.0:
            super().add(self._rewarded(step))

    def _before_episode(self, generator: np.random.Generator) -> None:
        """Adds what algorithm 1 draws before an episode is explored."""
        if self._gri.p_demo == 1.0:
            self._demonstrate(generator)
        elif self._gri.unit == "episodes":
            while generator.random() < self._gri.p_demo:
                self._demonstrate(generator)

    def _catch_up(self) -> None:
        """Adds demonstrations until their share of all steps is p_demo."""
        share = self._gri.p_demo
        while share < 1.0 and self._demonstrated < share * (self._demonstrated + self._explored):
            self._demonstrate(np.random.default_rng([_DRAWN, self._seed, self._demonstrated]))

    def _demonstrate(self, generator: np.random.Generator) -> None:
        number = int(generator.integers(len(self._shown)))
        self._shown.feed(self, number, self._reward)
        self._demonstrated += self._shown.index.episodes[number].length

    def _rewarded(self, step: TensorDictBase) -> TensorDictBase:
        """The step, with the explorers' constant reward if there is one."""
        reward = self._gri.explorer_reward
        if reward is None:
            return step
        after = step["next"].copy()
        after["reward"] = after["reward"].new_full(after["reward"].shape, reward)
        return step.copy().update({"next": after})

    def state(self) -> dict[str, Any]:
        """See `Replay`."""
        return {**super().state(), "explored": self._explored, "demonstrated": self._demonstrated}

    def restore(self, state: Mapping[str, Any]) -> None:
        """See `Replay`; all rows begin new episodes."""
        super().restore(state)
        self._explored, self._demonstrated = state["explored"], state["demonstrated"]
        self._begun = np.zeros(0, np.int64)


def room_for_demonstrations(gri: GriConfig, shown: Demonstrations, steps: int) -> int:
    """Entries that demonstrations may need while the explorers take some steps.

    Twice their mean number, since with "episodes" it is random.
    """
    if not gri.p_demo:
        return 0
    longest = max(entry.length for entry in shown.index.episodes) + 1
    per_episode = 1.0 if gri.p_demo == 1.0 else gri.p_demo / (1.0 - gri.p_demo)
    explored = longest if gri.unit == "steps" and gri.p_demo < 1.0 else min(gri.shortest, longest)
    return math.ceil(2.0 * per_episode * (steps / explored + 1.0)) * longest
