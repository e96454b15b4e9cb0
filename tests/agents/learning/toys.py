"""Trainers of small tasks, as `dohyo train tests.agents.learning.toys:POINT`."""

from __future__ import annotations

from dohyo.agents.learning.algorithms.ppo import ppo_trainer
from dohyo.agents.learning.algorithms.ppo_config import PpoConfig, PpoRunConfig
from tests.agents.learning.problems import Lock, Point
from tests.agents.learning.street import Street

SMALL = PpoConfig(
    learning_rate=1e-3, batch=64, epochs=6, hidden=(32, 32), initial_std=0.5, entropy=0.0, guided_decay=0.97
)


class ToyConfig(PpoRunConfig):
    """A short run in one process."""

    steps: int = 1024
    processes: int = 0
    evaluate_every: int = 512
    checkpoint_every: int = 256
    tensorboard: bool = False
    ppo: PpoConfig = SMALL


class PointConfig(ToyConfig):
    """See `Point`."""

    slow_s: float = 0.0
    fragile: str = ""


POINT = ppo_trainer("a point that comes to rest", PointConfig, lambda config: Point(config.slow_s, config.fragile))
LOCK = ppo_trainer("a lock that opens", ToyConfig, lambda config: Lock())
STREET = ppo_trainer("a car on a street, in SUMO", ToyConfig, lambda config: Street())
