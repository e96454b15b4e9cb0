"""RewardMeter: rewards of egos from tick to tick, where the environment itself gives none."""

from __future__ import annotations

from typing import NamedTuple

from dohyo.sumo_networks.envs.reward import make_reward
from dohyo.sumo_networks.rules.episode_end import reached_goal
from dohyo.sumo_networks.world import World


class Outcome(NamedTuple):
    """What an ego's last tick gave.

    Attributes:
        reward: Of that tick.
        terminated: Whether the reward function, or the goal, ends the episode.
        success: Whether the ego has reached its goal.
    """

    reward: float
    terminated: bool
    success: bool


class RewardMeter:
    """Reads the same rewards as `DrivingEnv` gives, and ends nobody's drive."""

    def __init__(self, name: str, egos: int) -> None:
        """Begins an episode.

        Args:
            name: Name from `reward.REWARDS`.
            egos: Number of egos.

        Raises:
            UnknownNameError: No reward function has that name.
        """
        self._rewards = [make_reward(name) for _ in range(egos)]
        self._before: World | None = None
        self._outcomes: dict[str, Outcome] = {}

    def read(self, world: World) -> dict[str, Outcome]:
        """Outcomes of the egos that drove in the tick before; the same again for the same tick."""
        before = self._before
        if before is not None and before.tick == world.tick:
            return self._outcomes
        self._before = world
        if before is not None:
            driving = [index for index, active in enumerate(before.egos.active.tolist()) if active]
            self._outcomes = {world.egos.names[index]: self._outcome(before, world, index) for index in driving}
        return self._outcomes

    def _outcome(self, before: World, after: World, ego: int) -> Outcome:
        reward, ended = self._rewards[ego](before, after, ego)
        arrived = reached_goal(after, ego)
        return Outcome(float(reward), bool(ended or arrived), bool(arrived))
