"""RayWorker: a worker on a Ray cluster, in place of a process of this machine. Ray is the extra `cluster`."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from typing import Any

from dohyo.evaluation.running.ray_executor import (
    BEAT_S,
    LOCAL,
    NO_ANSWER,
    THREADS,
    ClusterActor,
    as_actor,
    connect,
    first_line,
    lost_calls,
    require_ray,
)
from dohyo.sumo_networks.envs.worker_process import Host, WorkerDeathError
from dohyo.sumo_networks.errors import SimulationError

START_S = 120.0
"""Time that an actor has to start, its place in the cluster included."""


def connect_to(address: str) -> Any:
    """The module `ray`, after it has connected this process to a cluster, unless it is.

    Args:
        address: Of the cluster, see `OffPolicyRunConfig`.

    Raises:
        InvalidInputError: Ray is not installed, or there is no such cluster.
    """
    ray = require_ray()
    if not ray.is_initialized():
        connect(ray, None if address == LOCAL else address)
    return ray


class RayWorker:
    """An actor with a host. Takes one command at a time, as `WorkerProcess` does."""

    def __init__(self, address: str, number: int, make_host: Callable[[], Host]) -> None:
        """Connects, see `connect_to`; the actor starts with the first command.

        Args:
            address: Of the cluster.
            number: Named in errors.
            make_host: Makes what carries out the commands, in the actor.

        Raises:
            InvalidInputError: As from `connect_to`.
        """
        self._ray = connect_to(address)
        self._number, self._make_host = number, make_host
        self._actor: Any = None
        self._ready: Any = None  # its answer that it has started, until that has come
        self._call: Any = None

    def send(self, command: str, *arguments: Any) -> None:
        """Begins a command of the host."""
        if self._actor is None:
            where = tuple(sys.path), os.environ.get(THREADS)
            self._actor = as_actor(self._ray, _HostActor).remote(*where, self._make_host)
            self._ready = self._actor.ready.remote()
        self._call = self._actor.carry_out.remote(command, *arguments)

    def receive(self) -> Any:
        """Waits for the end of the command.

        Raises:
            SimulationError: The cluster has had no processor free for the actor for two minutes.
            WorkerDeathError: The actor or its machine is lost.
            Exception: What the command raised.
        """
        if self._ready is not None and not self._ray.wait([self._ready], timeout=START_S)[0]:
            raise SimulationError(f"worker {self._number} (Ray): expected a free processor in the cluster, found none")
        self._ready = None
        try:
            while not self._ray.wait([self._call], timeout=BEAT_S)[0]:
                if lost_calls(self._ray, {self._call: self._actor}):
                    raise WorkerDeathError(f"worker {self._number} (Ray): {NO_ANSWER}")
            return self._ray.get(self._call)
        except self._ray.exceptions.RayTaskError as error:
            raise error.cause from error
        except self._ray.exceptions.RayError as error:
            raise WorkerDeathError(f"worker {self._number} (Ray): {first_line(error)}") from error

    def begin_stop(self) -> None:
        """Ends the actor."""
        if self._actor is not None:
            self._ray.kill(self._actor)
            self._actor = None

    def stop(self) -> None:
        """Ends the actor; the next command starts a new one."""
        self.begin_stop()


class _HostActor(ClusterActor):
    """See `RayWorker`."""

    def __init__(self, search_path: tuple[str, ...], threads: str | None, make_host: Callable[[], Host]) -> None:
        """See `ClusterActor`."""
        super().__init__(search_path, threads)
        self._host = make_host()

    def carry_out(self, command: str, *arguments: Any) -> Any:
        """See `Host`."""
        with self.ending():
            return self._host.carry_out(command, *arguments)
