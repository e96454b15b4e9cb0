"""Command: the navigation's instruction. A module of its own, since the kernels of routes take long to import."""

from __future__ import annotations

from enum import IntEnum


class Command(IntEnum):
    """Instruction of the navigation: the next manoeuvre within 30 m, or FOLLOW."""

    FOLLOW = 0
    LEFT = 1
    RIGHT = 2
    STRAIGHT = 3
    CHANGE_LEFT = 4
    CHANGE_RIGHT = 5
