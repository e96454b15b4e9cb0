"""Command: what the navigation says. Apart from routes, whose numeric kernels take long to import."""

from __future__ import annotations

from enum import IntEnum


class Command(IntEnum):
    """What the navigation says: the next manoeuvre within 30 m, or FOLLOW."""

    FOLLOW = 0
    LEFT = 1
    RIGHT = 2
    STRAIGHT = 3
    CHANGE_LEFT = 4
    CHANGE_RIGHT = 5
