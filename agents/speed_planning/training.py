"""Command of each training in this folder: several seeds, judged on held-out episodes, of which the best is shipped.

A seed with a stored checkpoint of the same settings is not trained again.
"""

from __future__ import annotations

import argparse
import json
import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch

from dohyo.agents.speed_planning.ppo import Actor, CopiedEnv, PpoConfig, as_json, train
from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.files import write_atomically


@dataclass(frozen=True)
class Lesson:
    """Learning problem, and its evaluation.

    Attributes:
        command: Module that runs it.
        checkpoint: File of the shipped policy.
        config: Settings of the training.
        world: Environment of a seed.
        judged: (R,) score of a policy in held-out environments.
        others: Scores of the baselines, by name.
        unit: Of these scores.
    """

    command: str
    checkpoint: Path
    config: PpoConfig
    world: Callable[[int], CopiedEnv]
    judged: Callable[[Actor], FloatArray]
    others: Callable[[], Mapping[str, FloatArray]]
    unit: str


def learned(lesson: Lesson, config: PpoConfig, seed: int, out: Path) -> Actor:
    """Policy of one seed: read from OUT/NAME-SEED.safetensors, or trained and written there.

    Raises:
        InvalidInputError: The file holds no policy.
    """
    path = out / f"{lesson.checkpoint.stem}-{seed}.safetensors"
    notes = path.with_suffix(".json")
    if notes.exists() and json.loads(notes.read_text())["config"] == json.loads(as_json(config, seed, []))["config"]:
        return Actor.load(path)
    actor, curve = train(lesson.world(seed), config, seed, lambda at, mean: print(f"{at}: {mean:.4f}", flush=True))
    actor.save(path)
    write_atomically(notes, as_json(config, seed, curve).encode())
    return actor


def run(lesson: Lesson, description: str | None = None) -> None:
    """Command-line entry point."""
    parser = argparse.ArgumentParser(prog=f"python -m {lesson.command}", description=description)
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1, 2])
    parser.add_argument("--iterations", type=int, default=lesson.config.iterations)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--ship", action="store_true", help="copy the best seed's checkpoint into the package")
    given = parser.parse_args()
    torch.set_num_threads(1)
    given.out.mkdir(parents=True, exist_ok=True)
    config = replace(lesson.config, iterations=given.iterations)
    results = {name: earned.tolist() for name, earned in lesson.others().items()}
    for seed in given.seeds:
        results[f"rl-{seed}"] = lesson.judged(learned(lesson, config, seed, given.out)).tolist()
    for name, values in results.items():
        print(f"{name}: {np.mean(values):.4f} {lesson.unit}")
    write_atomically(given.out / "held_out.json", json.dumps(results).encode())
    if given.ship:
        best = max(given.seeds, key=lambda seed: float(np.mean(results[f"rl-{seed}"])))
        for suffix in (".safetensors", ".json"):
            shutil.copy(given.out / f"{lesson.checkpoint.stem}-{best}{suffix}", lesson.checkpoint.with_suffix(suffix))
