"""What a VectorDrivingEnv and its workers share: memory without a name, and pipes looked at before sleeping on them."""

from __future__ import annotations

import ctypes
import os
import select
import time
from collections.abc import Mapping
from dataclasses import dataclass
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnContext
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import DTypeLike, NDArray

from dohyo.sumo_networks.arrays import BoolArray, Float32Array, FloatArray, IntArray
from dohyo.sumo_networks.rendering.overhead import FRAME_SHAPE

Observations = dict[str, Float32Array]

# A process that sleeps between two ticks of 0.2 ms finds its core halted and its caches cold, and its tick takes half
# as long again. So both sides look for the next message for a while before they sleep, and yield the core meanwhile.
SPIN_S = 0.0005


@dataclass(slots=True)
class Arrays:
    """What parent and workers share, as numpy arrays on the same memory; N environments of E egos.

    Attributes:
        seed: (1,) of the run.
        episode: (N,) number of the episode that is driven.
        renewed: (N,) whether the last step ended an episode and began the next.
        actions: (N, E, ...).
        rewards: (N, E).
        terminations: (N, E).
        truncations: (N, E).
        active: (N, E) whether the ego drove in the last tick.
        observations: (N, E, ...) by sensor.
        finals: The same, of the last tick of the episode before; valid where `renewed`.
        frames: (N, H, W, 3) the pictures drawn last; N is 0 without a render mode.
    """

    seed: IntArray
    episode: IntArray
    renewed: BoolArray
    actions: Float32Array
    rewards: FloatArray
    terminations: BoolArray
    truncations: BoolArray
    active: BoolArray
    observations: Observations
    finals: Observations
    frames: NDArray[np.uint8]


class SharedMemory:
    """The memory itself, as it travels to the workers."""

    def __init__(
        self,
        context: SpawnContext,
        envs: int,
        egos: int,
        sensors: Mapping[str, gymnasium.spaces.Box],
        action: tuple[int, ...],
        *,
        renders: bool,
    ) -> None:
        def block(dtype: DTypeLike, *shape: int) -> Block:
            raw = context.RawArray(ctypes.c_byte, int(np.prod(shape)) * np.dtype(dtype).itemsize)
            return raw, np.dtype(dtype).str, shape

        self._fields = {
            "seed": block(np.int64, 1),
            "episode": block(np.int64, envs),
            "renewed": block(np.bool_, envs),
            "actions": block(np.float32, envs, egos, *action),
            "rewards": block(np.float64, envs, egos),
            **{name: block(np.bool_, envs, egos) for name in ("terminations", "truncations", "active")},
            "frames": block(np.uint8, envs if renders else 0, *FRAME_SHAPE),
        }
        self._observations = {name: block(box.dtype, envs, egos, *box.shape) for name, box in sensors.items()}
        self._finals = {name: block(box.dtype, envs, egos, *box.shape) for name, box in sensors.items()}

    def arrays(self) -> Arrays:
        """Views on it, for this process."""
        return Arrays(
            **{name: _view(block) for name, block in self._fields.items()},
            observations={name: _view(block) for name, block in self._observations.items()},
            finals={name: _view(block) for name, block in self._finals.items()},
        )


Block = tuple[Any, str, tuple[int, ...]]


def _view(block: Block) -> NDArray[Any]:
    raw, dtype, shape = block
    return np.frombuffer(raw, dtype=dtype).reshape(shape)


class WorkerPipe:
    """One end of a pipe between parent and worker."""

    def __init__(self, pipe: Connection) -> None:
        self._pipe = pipe
        self._poll = select.poll()
        self._poll.register(pipe.fileno(), select.POLLIN)
        self.send, self.close = pipe.send_bytes, pipe.close

    def receive(self) -> bytes:
        """The next message; EOFError or OSError where the other end is gone."""
        patience = time.perf_counter() + SPIN_S
        while not self._poll.poll(0) and time.perf_counter() < patience:
            os.sched_yield()
        return self._pipe.recv_bytes()
