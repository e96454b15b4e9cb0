"""Names of all objects in SUMO: the only module that makes and parses them."""

from __future__ import annotations

import re
from enum import StrEnum

_ROLE = re.compile(r"[a-z]*")
_APPROACH = ":approach"
_EVENT_ACTOR = re.compile(r"event:.*-\d+")


class Role(StrEnum):
    """Role of an actor in the scenario; every name begins with it."""

    VEHICLE = "vehicle"
    BICYCLE = "bicycle"
    PEDESTRIAN = "pedestrian"
    FLOW = "flow"
    JAYWALKER = "jaywalker"
    OBSTACLE = "obstacle"
    EVENT = "event"
    EXTERNAL = "external"
    EGO = "ego"


TRAFFIC = frozenset({Role.VEHICLE, Role.BICYCLE, Role.FLOW})
"""Roles of the vehicles that may be removed if a scripted actor needs their place."""
_ROLES = {role.value: role for role in Role}


def role_of(name: str) -> Role | None:
    """Role at the beginning of a name; None if the name has no role."""
    match = _ROLE.match(name)
    return _ROLES.get(match[0]) if match else None


def numbered(role: Role, number: int) -> str:
    """Name of a vehicle, bicycle, pedestrian, vehicle of a flow, jaywalker or obstacle."""
    return f"{role}-{number}"


def predicted(name: str) -> str:
    """Name of the proxy at the predicted place of an actor."""
    return f"{name}:ahead"


def approaching(name: str) -> str:
    """Name of the second proxy of an ego, with which it approaches a junction from beside its route."""
    return f"{name}{_APPROACH}"


def is_approaching(name: str) -> bool:
    """Whether a name is one of `approaching`."""
    return role_of(name) is Role.EGO and name.endswith(_APPROACH)


def event_actor(event: str, number: int) -> str:
    """Name of an actor that the script of an event moves."""
    return f"{Role.EVENT}:{event}-{number}"


def is_event_actor(name: str) -> bool:
    """Whether the script of an event moves an actor, and not SUMO."""
    return _EVENT_ACTOR.fullmatch(name) is not None


def event_vehicle(event: str, number: int) -> str:
    """Name of a vehicle that an event sends and SUMO drives."""
    return f"{Role.EVENT}:{event}-flow{number}"


def external_actor(name: str) -> str:
    """Name of an actor that another simulator moves."""
    return f"{Role.EXTERNAL}:{name}"


def ego_proxy(ego: str) -> str:
    """Name of the SUMO proxy of an ego."""
    return f"{Role.EGO}:{ego}"
