"""Cluster: connection of an episode process to a Ray cluster. Ray is the extra `cluster`.

The episode process only waits for a Ray actor whose worker process drives, as in
`dohyo.evaluation.running.ray_executor`. Machines need not share a disk: an uploaded policy is sent as bytes, record and
trajectory are sent back. The episode process holds the connection, so that a fault of Ray cannot end the server.
"""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from dohyo.evaluation.records.record import EpisodeRecord
from dohyo.evaluation.running.ray_executor import (
    BEAT_S,
    NO_ANSWER,
    THREADS,
    Station,
    as_actor,
    connect,
    first_line,
    lost_calls,
    require_ray,
    write_here,
)
from dohyo.service.policies.agent import ENTRY, FOLDER_VARIABLE
from dohyo.service.running.order import EpisodeOrder, checked_job
from dohyo.sumo_networks.errors import InvalidInputError, SimulationError


def check_cluster(address: str) -> None:
    """Refuses a cluster that cannot be reached.

    Raises:
        InvalidInputError: Ray is not installed, or no cluster answers at that address.
    """
    ray = require_ray()
    try:
        connect(ray, address)
    except InvalidInputError as error:
        raise InvalidInputError(f"{error} (ray start --head begins a cluster, --ray-address names one)") from error
    ray.shutdown()


class Cluster:
    """A cluster worker for one episode at a time; its Ray actor is reused."""

    def __init__(self, address: str) -> None:
        """Connects.

        Raises:
            SimulationError: The cluster cannot be reached.
        """
        self._ray = require_ray()
        try:
            connect(self._ray, address)
        except InvalidInputError as error:  # it answered when the service started, so this is an infrastructure fault
            raise SimulationError(str(error)) from error
        self._station: Any = None

    def drive(self, order: EpisodeOrder) -> None:
        """Drives an order on the cluster and writes its record on this machine.

        Raises:
            InvalidInputError: The order cannot be driven, or the machines have different versions.
            SimulationError: Ray lost the actor or its machine.
        """
        policies = _policies_of(order)
        try:
            if self._station is None:
                self._station = as_actor(self._ray, PolicyStation).remote(tuple(sys.path), os.environ.get(THREADS))
                self._ray.get(self._station.ready.remote())
            call = self._station.drive_order.remote(order, policies)
            while not self._ray.wait([call], timeout=BEAT_S)[0]:
                if lost_calls(self._ray, {call: self._station}):
                    raise self._lost(NO_ANSWER)
            record, columns = self._ray.get(call)
        except self._ray.exceptions.RayError as error:
            cause = getattr(error, "cause", None)
            if isinstance(cause, InvalidInputError):
                raise InvalidInputError(str(cause)) from None
            raise self._lost(first_line(error)) from error
        write_here(order.job, record, columns)

    def _lost(self, why: str) -> SimulationError:
        """Gives the actor up; the error that says why."""
        self._ray.kill(self._station)
        self._station = None
        return SimulationError(f"Ray lost its worker: {why}")


class PolicyStation(Station):
    """A station that receives uploaded policies and drives only submitted code."""

    def __init__(self, search_path: Sequence[str], threads: str | None) -> None:
        """See `Station`; its worker process looks for policies in a folder of its own."""
        self._policies = tempfile.TemporaryDirectory(prefix="dohyo-policies-")
        os.environ[FOLDER_VARIABLE] = self._policies.name
        super().__init__(search_path, threads)

    def drive_order(self, order: EpisodeOrder, policies: Mapping[str, bytes]) -> tuple[EpisodeRecord, dict[str, Any]]:
        """Drives one order; see `Station.drive`.

        Args:
            order: Order to drive.
            policies: Content of each uploaded policy that drives, by its file name.

        Raises:
            InvalidInputError: The agent's code on this machine differs from the submitted one.
        """
        with self.ending():
            for name, content in policies.items():
                Path(self._policies.name, name).write_bytes(content)
            return self.drive(checked_job(order))


def _policies_of(order: EpisodeOrder) -> dict[str, bytes]:
    """Content of each uploaded policy that drives an ego, by its file name."""
    infos = [info for info in order.infos.values() if info.entry == ENTRY]
    paths = {Path(os.environ[FOLDER_VARIABLE], f"{info.settings['sha256']}.onnx") for info in infos}
    try:
        return {path.name: path.read_bytes() for path in paths}
    except OSError as error:
        name = Path(str(error.filename)).name
        raise InvalidInputError(f"policy '{name}' cannot be read: {error.strerror}") from error
