"""How long 100,000 steps of karts take on one core, with observations, and a decision of the shipped policy.

Time is that on the processor, since a busy machine would tell more of its other work.

`OMP_NUM_THREADS=1 python -m tests.performance.parking`
"""

from __future__ import annotations

import time

import numpy as np

from dohyo.agents.parking.policy_agent import PolicyAgent
from dohyo.sumo_networks.parking.generate import Scene
from dohyo.sumo_networks.parking.observation import COLUMNS
from dohyo.sumo_networks.parking.world import ParkingWorld

LOTS, TICKS, ROUNDS = 512, 100, 15
DECISIONS = 2000


def measure(scene: Scene, karts: int) -> float:
    """Milliseconds of 100,000 kart-steps, the median over rounds; karts roam at random, as when a training begins."""
    rng, world, seed = np.random.default_rng(0), ParkingWorld(LOTS, karts), 0
    world.draw(range(LOTS), range(LOTS), scene)
    actions = rng.uniform(-1, 1, (TICKS, LOTS, karts, 3))
    actions[..., 0] = np.abs(actions[..., 0])
    rounds = []
    for _ in range(ROUNDS):
        steps, spent = 0, 0.0
        for action in actions:
            steps += int(np.count_nonzero(world.running))
            began = time.process_time()
            world.step(action)
            spent += time.process_time() - began
            ended = np.flatnonzero(~world.running.any(axis=1))
            if len(ended):
                seed += LOTS
                world.draw(ended, seed + ended, scene)
        rounds.append(1e3 * spent / steps * 100_000)
    return float(np.median(rounds[1:]))


def decision_ms() -> float:
    """Milliseconds of a decision, the median over rounds."""
    agent, rng, rounds = PolicyAgent(), np.random.default_rng(0), []
    seen = rng.uniform(-1, 1, (DECISIONS, COLUMNS)).astype(np.float32)
    for _ in range(ROUNDS):
        began = time.process_time()
        for one in seen:
            agent.act(one)
        rounds.append(1e3 * (time.process_time() - began) / DECISIONS)
    return float(np.median(rounds[1:]))


def main() -> None:
    """Prints all scenes, and the decision."""
    for scene, karts in ((Scene.SIMPLE, 1), (Scene.COMPLEX, 1), (Scene.COMPLEX, 3), (Scene.PEDESTRIANS, 1)):
        ms = measure(scene, karts)
        print(f"{scene.name.lower()}, {karts} karts: {ms:.1f} ms, {100 / ms:.2f} million steps per second")
    print(f"decision: {decision_ms():.3f} ms")


if __name__ == "__main__":
    main()
