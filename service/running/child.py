"""An episode process: drives one order after the other until the server closes its channel or dies.

Started as `python -m dohyo.service.running.child CHANNEL ALARM [CLUSTER]`, two file descriptors. The alarm is shared
memory with one float64: the moment on the monotonic clock by which the agent must have returned, 0 while none is
called. CLUSTER is the address of a Ray cluster that drives instead, all but the episodes of policy workers.
"""

from __future__ import annotations

import mmap
import os
import select
import socket
import sys
import threading
import time
import traceback
from functools import cache
from typing import TYPE_CHECKING

from dohyo.evaluation.running.executors import drive_job, lost_episode
from dohyo.service.running.channel import Channel, Kind
from dohyo.service.running.order import EpisodeOrder, checked_job
from dohyo.service.running.remote import drive_remotely
from dohyo.sumo_networks.errors import InvalidInputError

if TYPE_CHECKING:
    from dohyo.service.running.cluster import Cluster

ALARM_BYTES = 8


def main() -> None:
    """Drives orders until the server is gone."""
    channel = Channel(socket.socket(fileno=int(sys.argv[1])))
    alarm = memoryview(mmap.mmap(int(sys.argv[2]), ALARM_BYTES)).cast("d")
    threading.Thread(target=end_with_server, args=(channel.fileno(),), daemon=True).start()
    while (frame := channel.receive()) is not None:
        if frame[0] is Kind.ORDER:  # other frames belonged to an episode that has ended
            alarm[0] = 0.0
            channel.send(*_drive(EpisodeOrder.model_validate_json(frame[1]), channel, alarm))


def _drive(order: EpisodeOrder, channel: Channel, alarm: memoryview[float]) -> tuple[Kind, bytes]:
    def watch(seconds: float) -> None:
        alarm[0] = time.monotonic() + seconds if seconds else 0.0

    try:
        if order.verdict is not None:
            lost_episode(order.job, *order.verdict)
        elif order.remote:
            return Kind.FINISHED, drive_remotely(order, channel)
        elif len(sys.argv) > 3:
            _cluster(sys.argv[3]).drive(order)
        else:
            drive_job(checked_job(order), watch)
    except InvalidInputError as error:  # a second attempt would fail in the same way
        return Kind.IMPOSSIBLE, str(error).encode()
    except Exception as error:  # an internal error or a full disk: the server decides whether to try again
        traceback.print_exc()
        return Kind.FAILED, f"{type(error).__name__}: {error}"[:1000].encode()
    return Kind.FINISHED, b""


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
