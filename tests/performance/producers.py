"""Transitions per second of GRIAD's explorers, each a process that drives and encodes its pictures.

    OMP_NUM_THREADS=1 python -m tests.performance producers

The time is that of the clock, so that a busy machine tells less than two idle cores.
"""

from __future__ import annotations

import multiprocessing
import statistics
import time
from multiprocessing.queues import SimpleQueue
from multiprocessing.synchronize import Barrier

import numpy as np
import torch
from tensordict import TensorDict

from dohyo.agents.gri.driving.choices import nearest
from dohyo.agents.gri.driving.task import DrivingTask
from dohyo.agents.learning.experience.behaviour import PolicyBehaviour
from dohyo.agents.learning.experience.explorers import Explorers

BLOCKS, STRETCHES = 7, 4
STRETCH = 50
"""Steps, as in `agents/gri/configs/griad.toml`."""
APART_S = 15.0
STRAIGHT_ON = nearest(np.array([2.0, 0.0]))
"""The choice that accelerates and does not steer; episodes end and begin as in a training."""


def transitions_per_s(most: int = 2) -> dict[int, float]:
    """By number of explorers, the median over blocks that alternate."""
    made = {count: Explorers(DrivingTask("pictures"), 0, count, STRETCH) for count in range(1, most + 1)}
    rates: dict[int, list[float]] = {count: [] for count in made}
    try:
        for block in range(BLOCKS + 1):
            for count, explorers in made.items():
                began, before = time.perf_counter(), explorers.steps
                for _ in explorers.round(STRETCHES * STRETCH):
                    explorers.send(PolicyBehaviour(straight_on))
                    list(explorers.received())
                if block:  # the first one starts the simulations
                    rates[count].append((explorers.steps - before) / (time.perf_counter() - began))
    finally:
        for explorers in made.values():
            explorers.close()
    return {count: statistics.median(values) for count, values in rates.items()}


def straight_on(seen: TensorDict) -> TensorDict:
    """A policy that accelerates and does not steer."""
    return TensorDict({"action": torch.full((len(seen),), STRAIGHT_ON)}, seen.batch_size)


def apart_per_s(most: int = 2) -> dict[int, float]:
    """The same of processes that wait for nobody: what the cores of the machine have to give."""
    context, rates = multiprocessing.get_context("spawn"), dict[int, float]()
    for count in range(1, most + 1):
        together, told = context.Barrier(count), context.SimpleQueue()
        processes = [context.Process(target=_drive, args=(together, told)) for _ in range(count)]
        for process in processes:
            process.start()
        rates[count] = sum(told.get() for _ in processes)
        for process in processes:
            process.join()
    return rates


def _drive(together: Barrier, told: SimpleQueue[float]) -> None:
    """Tells the transitions per second of one environment, beginning when all others have; all have the same seeds."""
    env, seed, steps = DrivingTask("pictures").make_env(0), 0, 0
    env.reset(seed=seed)
    together.wait()
    began = time.perf_counter()
    while time.perf_counter() < began + APART_S:
        _, _, terminated, truncated, _ = env.step(STRAIGHT_ON)
        steps += 1
        if terminated or truncated:
            env.reset(seed=(seed := seed + 1))
    told.put(steps / (time.perf_counter() - began))
    env.close()
