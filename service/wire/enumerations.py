"""Enumerations that sensors give as numbers."""

from __future__ import annotations

from enum import IntEnum

from dohyo.sumo_networks.routes.command import Command
from dohyo.sumo_networks.rules.right_of_way import RightOfWay
from dohyo.sumo_networks.world import ActorKind, LightState

ENUMERATIONS: dict[str, type[IntEnum]] = {
    "state of a light": LightState,
    "kind of an actor": ActorKind,
    "command of the navigation": Command,
    "right of way": RightOfWay,
}


def enumeration_documents() -> dict[str, dict[str, int]]:
    """Numbers by name, for each enumeration."""
    return {what: {one.name.lower(): one.value for one in members} for what, members in ENUMERATIONS.items()}


def in_words(members: type[IntEnum]) -> str:
    """An enumeration as text, such as "0 off, 1 red"."""
    return ", ".join(f"{one.value} {one.name.lower().replace('_', ' ')}" for one in members)
