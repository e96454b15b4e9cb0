"""Training of the set-points: `python -m dohyo.agents.speed_planning.acc_training --seeds 0 1 2 --out out/acc`.

The field test's policy took 33 million steps of 0.1 s; this is the same algorithm on the same kind of platoon for
fewer, with a decision every 0.5 s. `--ship` copies the best seed behind held-out leaders.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from dohyo.agents.speed_planning import acc
from dohyo.agents.speed_planning.platoon import PlatoonEnv
from dohyo.agents.speed_planning.ppo import PpoConfig
from dohyo.agents.speed_planning.training import Lesson, run
from dohyo.sumo_networks.arrays import FloatArray

CONFIG = PpoConfig(iterations=15, hidden=(64, 64, 64, 64), learning_rate=1e-3, batch=2560, epochs=5, gamma=0.97)
HELD_OUT = 10_000


def follows_traffic(observation: FloatArray) -> FloatArray:
    """The cruise control left at 80 mph and the middle gap: it only follows."""
    return np.tile((1.0, 0.0), (len(observation), 1))


def follows_plan(observation: FloatArray) -> FloatArray:
    """The plan's speed, rounded up to whole m/s, and the middle gap, as a driver could set them by hand."""
    plan = observation[:, 7] * 40
    return np.stack([np.ceil(plan) / 20 - 1 + 1e-6, np.zeros(len(plan))], axis=1)


def reward(policy: Callable[[FloatArray], FloatArray], seed: int = HELD_OUT) -> FloatArray:
    """(R,) mean reward per decision behind the leaders of one seed."""
    env = PlatoonEnv(seed)
    observation, over = env.reset(), False
    total, decisions = np.zeros(env.roads), 0
    while not over:
        observation, gained, over = env.step(policy(observation))
        total, decisions = total + gained, decisions + 1
    return total / decisions


LESSON = Lesson(
    command="dohyo.agents.speed_planning.acc_training",
    checkpoint=acc.CHECKPOINT,
    config=CONFIG,
    world=PlatoonEnv,
    judged=lambda actor: reward(actor.act),
    others=lambda: {"follows-traffic": reward(follows_traffic), "follows-plan": reward(follows_plan)},
    unit="per decision",
)

if __name__ == "__main__":
    run(LESSON, __doc__)
