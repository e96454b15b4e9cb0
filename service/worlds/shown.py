"""What a world's process tells the server of each tick."""

from __future__ import annotations

import struct

import msgspec

SHOWN = struct.Struct("!IdI")  # tick, simulated time [s], revision of the drivers; then `Shown` in msgpack


class Shown(msgspec.Struct):
    """The egos that drive, and what their drivers observe, each in msgpack."""

    driving: list[str]
    observations: dict[str, msgspec.Raw]
