"""ProcessVectorEnv: environments that step at the same time, one process each, as libsumo is global to its process.

Parent and workers share the memory of actions, observations, rewards and ends; nothing else is sent at a step.
"""

from __future__ import annotations

import weakref
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

from numpy.typing import NDArray

from dohyo.sumo_networks.envs.env_rows import EnvRows, RowArrays, RowPlan
from dohyo.sumo_networks.envs.row_vector_env import RowVectorEnv
from dohyo.sumo_networks.envs.shared_memory import SharedMemory
from dohyo.sumo_networks.envs.worker_process import WorkerProcess
from dohyo.sumo_networks.processes import worker_context


class ProcessVectorEnv(RowVectorEnv):
    """See `RowVectorEnv`. `make_env` is sent to the workers, so pickle must be able to find it."""

    def _take_arrays(self) -> RowArrays:
        memory = SharedMemory(worker_context(), self._plan.layout())
        self._workers: list[WorkerProcess] = []
        self._finalizer = weakref.finalize(self, _stop_all, self._workers)
        for rank in range(self._plan.groups):
            self._workers.append(WorkerProcess(rank, partial(_make_rows, self._plan, memory, rank)))
        return RowArrays.of(memory.arrays(), self.single_observation_space)

    @property
    def pids(self) -> tuple[int, ...]:
        """Process ids of the workers; empty once closed."""
        return tuple(worker.pid for worker in self._workers if worker.pid is not None)

    def _send(self, group: int, command: str, *arguments: Any) -> None:
        self._workers[group].send(command, *arguments)

    def _receive(self, group: int) -> Any:
        return self._workers[group].receive()

    def _discard(self, group: int) -> None:
        self._workers[group].stop()

    def close_extras(self, **kwargs: Any) -> None:
        """Ends the processes; `close` calls it once."""
        self._finalizer()


def _make_rows(plan: RowPlan, memory: SharedMemory, rank: int) -> EnvRows:
    arrays: Mapping[str, NDArray[Any]] = memory.arrays()
    return EnvRows(plan, arrays, rank)


def _stop_all(workers: Sequence[WorkerProcess]) -> None:
    for worker in workers:
        worker.begin_stop()
    for worker in workers:
        worker.stop()
