"""Memory and pipes between a VectorDrivingEnv and its workers: unnamed shared memory, and polled pipes."""

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

# After a sleep between two ticks of 0.2 ms, the core is halted and its caches are cold, and a tick takes 50 % longer.
# So both sides poll for the next message for a time before they sleep, and yield the core between polls.
SPIN_S = 0.0005


@dataclass(slots=True)
class Arrays:
    """Shared memory of parent and workers as numpy arrays; N environments of E egos.

    Attributes:
        seed: (1,) seed of the run.
        episode: (N,) number of the current episode.
        renewed: (N,) whether the last step ended an episode and began the next.
        actions: (N, E, ...) actions of the next tick.
        rewards: (N, E) rewards of the last tick.
        terminations: (N, E) whether the ego's episode terminated.
        truncations: (N, E) whether the ego's episode was truncated.
        active: (N, E) whether the ego drove in the last tick.
        observations: (N, E, ...) observations by sensor.
        finals: (N, E, ...) last observations of the previous episode by sensor; valid where `renewed`.
        frames: (N, H, W, 3) last pictures; N is 0 without a render mode.
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
    """The shared memory, in the form that is sent to the workers."""

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
        """Views of the memory as arrays of this process."""
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
        """Receives the next message; raises EOFError or OSError if the other end is closed."""
        patience = time.perf_counter() + SPIN_S
        while not self._poll.poll(0) and time.perf_counter() < patience:
            os.sched_yield()
        return self._pipe.recv_bytes()
