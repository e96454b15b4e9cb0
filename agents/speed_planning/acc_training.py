"""Learning the set-points: `python -m agents.speed_planning.acc_training --seeds 0 1 2 --out out/acc`.

The field test's policy took 33 million steps of 0.1 s; this is the same algorithm on the same kind of platoon for
fewer, with a decision every 0.5 s. `--ship` copies the seed that does best behind held-out leaders.
"""

from __future__ import annotations

import argparse
import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch

from agents.speed_planning import acc
from agents.speed_planning.platoon import PlatoonEnv
from agents.speed_planning.ppo import PpoConfig, as_json, train
from evaluation.store import write_atomically
from sumo_networks.arrays import FloatArray

CONFIG = PpoConfig(iterations=25, hidden=(64, 64, 64, 64), learning_rate=1e-3, batch=2560, epochs=5, gamma=0.97)
HELD_OUT = 10_000


def follows_traffic(observation: FloatArray) -> FloatArray:
    """The cruise control left at 80 mph and the middle gap: it only follows."""
    return np.tile((1.0, 0.0), (len(observation), 1))


def follows_plan(observation: FloatArray) -> FloatArray:
    """The plan's speed, rounded up to whole m/s, and the middle gap: what a driver could set by hand."""
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


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(prog="python -m agents.speed_planning.acc_training", description=__doc__)
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1, 2])
    parser.add_argument("--iterations", type=int, default=CONFIG.iterations)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--ship", action="store_true", help="copy the best seed's checkpoint into the package")
    given = parser.parse_args()
    torch.set_num_threads(1)
    given.out.mkdir(parents=True, exist_ok=True)
    config = replace(CONFIG, iterations=given.iterations)
    results = {"follows-traffic": reward(follows_traffic).tolist(), "follows-plan": reward(follows_plan).tolist()}
    for seed in given.seeds:
        path = given.out / f"acc-{seed}.safetensors"
        actor, curve = train(PlatoonEnv(seed), config, seed, lambda at, mean: print(f"{at}: {mean:.4f}", flush=True))
        actor.save(path)
        write_atomically(path.with_suffix(".json"), as_json(config, seed, curve).encode())
        results[f"rl-{seed}"] = reward(actor.act).tolist()
    for name, values in results.items():
        print(f"{name}: {np.mean(values):.4f} per decision")
    write_atomically(given.out / "held_out.json", json.dumps(results).encode())
    if given.ship:
        best = max(given.seeds, key=lambda seed: float(np.mean(results[f"rl-{seed}"])))
        for suffix in (".safetensors", ".json"):
            shutil.copy(given.out / f"acc-{best}{suffix}", acc.CHECKPOINT.with_suffix(suffix))


if __name__ == "__main__":
    main()
