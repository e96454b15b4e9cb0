"""What a world's process and the server tell each other of each tick."""

from __future__ import annotations

import struct
from typing import Any

import msgspec

from dohyo.service.simulating.actors import ActorChange, ShownActor
from dohyo.sumo_networks.envs.reward_meter import Outcome

SHOWN = struct.Struct("!IdI")  # tick, simulated time [s], revision of the drivers; then `Shown` in msgpack


class Shown(msgspec.Struct):
    """From the process: a tick.

    Attributes:
        driving: Egos that drive.
        poses: x, y [m], heading [rad], velocity x, y [m/s] of each of them.
        observations: What their drivers observe, each in msgpack.
        actors: All egos and the traffic; None: no simulator is coupled to the world.
        outcomes: Of the egos that drove in the last tick, in a world with a reward.
    """

    driving: list[str]
    poses: dict[str, tuple[float, float, float, float, float]]
    observations: dict[str, msgspec.Raw]
    actors: list[ShownActor] | None = None
    outcomes: dict[str, Outcome] = {}


class Decided(msgspec.Struct):
    """To the process: the decisions for a tick.

    Attributes:
        actions: Packed action of each ego that has a driver.
        actors: External actors that change before the tick.
    """

    actions: dict[str, Any]
    actors: ActorChange
