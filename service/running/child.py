"""An episode process: drives one order after the other until the server closes its channel or dies.

Started as `python -m dohyo.service.running.child CHANNEL GAUGE [CLUSTER]`, two file descriptors, of a socket and of the
shared memory of `dohyo.service.running.gauge`. CLUSTER is the address of a Ray cluster that drives instead, all but the
episodes of policy workers.
"""

from __future__ import annotations

import os
import select
import socket
import sys
import threading
import traceback
from functools import cache
from typing import TYPE_CHECKING

from dohyo.evaluation.freeway.morning import MorningRecord, MorningScenario, write_morning
from dohyo.evaluation.running.executors import drive_job, lost_episode
from dohyo.service.confinement.rights import confine_episodes
from dohyo.service.running.channel import Channel, Kind
from dohyo.service.running.gauge import Gauge
from dohyo.service.running.order import EpisodeOrder, checked_job
from dohyo.service.running.remote import drive_remotely
from dohyo.sumo_networks.errors import InvalidInputError

if TYPE_CHECKING:
    from dohyo.service.running.cluster import Cluster


def main() -> None:
    """Drives orders until the server is gone."""
    if len(sys.argv) <= 3:  # a cluster's client needs the network
        confine_episodes()
    channel = Channel(socket.socket(fileno=int(sys.argv[1])))
    gauge = Gauge(int(sys.argv[2]))
    threading.Thread(target=end_with_server, args=(channel.fileno(),), daemon=True).start()
    while (frame := channel.receive()) is not None:
        if frame[0] is Kind.ORDER:  # other frames belonged to an episode that has ended
            gauge.clear()
            channel.send(*_drive(EpisodeOrder.model_validate_json(frame[1]), channel, gauge))


def _drive(order: EpisodeOrder, channel: Channel, gauge: Gauge) -> tuple[Kind, bytes]:
    try:
        if isinstance(order.scenario, MorningScenario):
            return Kind.FINISHED, _plan_morning(order, order.scenario, channel, gauge)
        if order.verdict is not None:
            lost_episode(order.job, *order.verdict)
        elif order.remote:
            return Kind.FINISHED, drive_remotely(order, channel, gauge.watch_worker)
        elif len(sys.argv) > 3:
            gauge.begin()
            _cluster(sys.argv[3]).drive(order)
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
        write_morning(order.directory, order.stem, record)
        return b""
    from dohyo.service.freeway.drive import drive_morning  # the freeway's simulation takes a second to import

    return drive_morning(order, scenario, channel, gauge.watch_worker)


@cache
def _cluster(address: str) -> Cluster:
    from dohyo.service.running.cluster import Cluster  # Ray takes a second to import, and may not be installed

    return Cluster(address)


def end_with_server(descriptor: int) -> None:
    """Exits this process once the server's end of the channel is closed."""
    hangup = select.poll()
    hangup.register(descriptor, 0)  # POLLHUP is always reported
    hangup.poll()
    os._exit(0)


if __name__ == "__main__":
    main()
