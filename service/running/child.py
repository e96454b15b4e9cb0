"""An episode process: drives one order after the other until the server closes its channel or dies.

A copy of a fork server calls `drive_here` with two file descriptors, of a socket and of the shared memory of
`dohyo.service.running.gauge`. `python -m dohyo.service.running.child CHANNEL GAUGE CLUSTER` is a new interpreter for a
Ray cluster, whose address is CLUSTER: it drives instead, all but the episodes of policy workers.
"""

from __future__ import annotations

import os
import select
import signal
import socket
import sys
import threading
import traceback
from functools import cache
from importlib import import_module
from typing import TYPE_CHECKING

from dohyo.evaluation.freeway.day import DayScenario
from dohyo.evaluation.freeway.morning import MorningRecord, MorningScenario
from dohyo.evaluation.parking.benchmark import LotScenario
from dohyo.evaluation.running.executors import drive_job, lost_episode
from dohyo.service.confinement.rights import confine_episodes
from dohyo.service.running.channel import Channel, Kind
from dohyo.service.running.faults import keep_fault
from dohyo.service.running.gauge import Gauge
from dohyo.service.running.order import EpisodeOrder, checked_job
from dohyo.service.running.remote import drive_remotely
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.processes import PRELOADED

if TYPE_CHECKING:
    from dohyo.service.running.cluster import Cluster


def prepare() -> None:
    """Loads what every episode needs, besides what this module imports."""
    import_module(PRELOADED)


def drive_here(channel: int, gauge: int) -> None:
    """Drives orders in this process, until the server is gone."""
    confine_episodes()
    serve(channel, gauge)


def serve(channel: int, gauge: int, cluster: str | None = None) -> None:
    """Drives orders until the server is gone.

    Args:
        channel: Descriptor of the socket.
        gauge: Descriptor of the shared memory.
        cluster: Address of the Ray cluster that drives; None: this process does.
    """
    frames, times = Channel(socket.socket(fileno=channel)), Gauge(gauge)
    threading.Thread(target=end_with_server, args=(channel,), daemon=True).start()
    while (frame := frames.receive()) is not None:
        if frame[0] is Kind.ORDER:  # other frames belonged to an episode that has ended
            times.clear()
            frames.send(*_drive(EpisodeOrder.model_validate_json(frame[1]), frames, times, cluster))


def _drive(order: EpisodeOrder, channel: Channel, gauge: Gauge, cluster: str | None) -> tuple[Kind, bytes]:
    try:
        if isinstance(order.scenario, MorningScenario):
            return Kind.FINISHED, _plan_morning(order, order.scenario, channel, gauge)
        if isinstance(order.scenario, LotScenario):
            from dohyo.service.parking.drive import park  # numba's kernels take a second to load

            return Kind.FINISHED, park(order, order.scenario, channel, gauge)
        if isinstance(order.scenario, DayScenario):
            from dohyo.service.forecasting.drive import forecast_day  # imports the freeway's simulation: slow

            return Kind.FINISHED, forecast_day(order, order.scenario, channel, gauge)
        if order.verdict is not None:
            lost_episode(order.job, *order.verdict)
        elif order.remote:
            return Kind.FINISHED, drive_remotely(order, channel, gauge.watch_worker)
        elif cluster is not None:
            gauge.begin()
            _cluster(cluster).drive(order)
        else:
            gauge.begin()
            drive_job(checked_job(order), gauge.watch)
    except InvalidInputError as error:  # a second attempt would fail in the same way
        return Kind.IMPOSSIBLE, str(error).encode()
    except Exception as error:  # an internal error or a full disk: the server decides whether to try again
        traceback.print_exc()
        return Kind.FAILED, f"{type(error).__name__}: {error}"[:1000].encode()
    return Kind.FINISHED, b""


def _plan_morning(order: EpisodeOrder, scenario: MorningScenario, channel: Channel, gauge: Gauge) -> bytes:
    if order.verdict is not None:
        record = MorningRecord(scenario=scenario, benchmark=order.benchmark, agent=order.info, failure=order.verdict[1])
        keep_fault(order.directory, order.stem, order.verdict[0])
        record.write(order.directory, order.stem)
        return b""
    from dohyo.service.freeway.drive import drive_morning  # the freeway's simulation takes a second to import

    return drive_morning(order, scenario, channel, gauge)


@cache
def _cluster(address: str) -> Cluster:
    from dohyo.service.running.cluster import Cluster  # Ray takes a second to import, and may not be installed

    connected = Cluster(address)
    _ignore_sigterm()  # again, since Ray has its own handler
    return connected


def end_with_server(descriptor: int) -> None:
    """Exits this process once the server's end of the channel is closed."""
    hangup = select.poll()
    hangup.register(descriptor, 0)  # POLLHUP is always reported
    hangup.poll()
    os._exit(0)


def _ignore_sigterm() -> None:
    """A signal to all processes of the service is the service's, which lets this process end its episode."""
    signal.signal(signal.SIGTERM, signal.SIG_IGN)


if __name__ == "__main__":
    _ignore_sigterm()
    serve(int(sys.argv[1]), int(sys.argv[2]), sys.argv[3])
