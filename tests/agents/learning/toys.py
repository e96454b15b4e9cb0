"""Trainers of small tasks, as `dohyo train tests.agents.learning.toys:POINT`."""

from __future__ import annotations

from dohyo.agents.learning.algorithms.ppo import ppo_trainer
from dohyo.agents.learning.algorithms.ppo_config import PpoConfig, PpoRunConfig
from dohyo.agents.learning.imitation.behaviour_cloning import CloningConfig, PolicyConfig, cloning_trainer
from dohyo.agents.learning.imitation.dagger import DaggerConfig, DaggerRunConfig, dagger_trainer
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


class PointDaggerConfig(DaggerRunConfig):
    """A short run in one process."""

    steps: int = 768
    processes: int = 0
    environments: int = 2
    evaluate_every: int = 768
    checkpoint_every: int = 256
    tensorboard: bool = False
    dagger: DaggerConfig = DaggerConfig(
        horizon=64, learning_rate=5e-3, batch=32, policy=PolicyConfig(loss="huber", hidden=(32,))
    )


class PointCloningConfig(CloningConfig):
    """A short run."""

    steps: int = 400
    evaluate_every: int = 200
    learning_rate: float = 1e-2
    policy: PolicyConfig = PolicyConfig(loss="huber", hidden=(32,))
    tensorboard: bool = False
    device: str = "cpu"


DAGGER = dagger_trainer("a point that comes to rest", PointDaggerConfig, lambda config: Point())
CLONING = cloning_trainer("a point that comes to rest", PointCloningConfig, lambda config: Point())
