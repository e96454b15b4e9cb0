"""Agents by name: whatever installed packages offer under the entry point group "dohyo.agents"."""

from __future__ import annotations

from importlib.metadata import entry_points

from sumo_networks.errors import InvalidInputError, UnknownNameError

GROUP = "dohyo.agents"


def agent_entries() -> dict[str, str]:
    """Each agent's "module:Class" by its name, sorted.

    Raises:
        InvalidInputError: Two installed packages offer the same name.
    """
    entries: dict[str, str] = {}
    for point in sorted(entry_points(group=GROUP), key=lambda point: point.name):
        if entries.setdefault(point.name, point.value) != point.value:
            raise InvalidInputError(f"agent '{point.name}' is offered twice: {entries[point.name]} and {point.value}")
    return entries


def resolve(name: str) -> str:
    """The "module:Class" of a registered name; what already has that form is returned as it is.

    Raises:
        UnknownNameError: No agent is registered under the name.
    """
    if ":" in name:
        return name
    entries = agent_entries()
    if name not in entries:
        raise UnknownNameError("agent", name, entries)
    return entries[name]
