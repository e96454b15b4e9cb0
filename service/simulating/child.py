"""The process of a world: a copy of a fork server calls `simulate_here` with a socket and shared memory."""

from __future__ import annotations

import socket
import threading
import traceback

from dohyo.service.confinement.rights import confine_episodes
from dohyo.service.running.channel import Channel, Kind
from dohyo.service.running.child import end_with_server
from dohyo.service.simulating.drive import drive_world
from dohyo.service.simulating.order import WorldOrder
from dohyo.sumo_networks.errors import InvalidInputError


def simulate_here(channel: int, gauge: int) -> None:
    """Simulates one world in this process; the shared memory of episodes is not used."""
    confine_episodes()
    frames = Channel(socket.socket(fileno=channel))
    threading.Thread(target=end_with_server, args=(channel,), daemon=True).start()
    frame = frames.receive()
    assert frame is not None
    frames.send(*_drive(WorldOrder.model_validate_json(frame[1]), frames))
    frames.receive()  # the server closes the channel


def _drive(order: WorldOrder, frames: Channel) -> tuple[Kind, bytes]:
    try:
        return Kind.FINISHED, drive_world(order, frames)
    except InvalidInputError as error:
        return Kind.IMPOSSIBLE, str(error).encode()
    except Exception as error:  # an internal error or a full disk
        traceback.print_exc()
        return Kind.FAILED, f"{type(error).__name__}: {error}"[:1000].encode()
