"""Files of an agent: those that it names as its own, and those that its settings alone name."""

from __future__ import annotations

import inspect
import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any


def parts_of(agent: Any) -> list[Any]:
    """An agent, and those that it wraps, from the outside in."""
    parts = [agent]
    while (inner := getattr(parts[-1], "inner", None)) is not None:
        parts.append(inner)
    return parts


def files_of(parts: Sequence[Any]) -> list[Path]:
    """Files that agents name as their own; records have their digest."""
    return [Path(file) for part in parts for file in getattr(part, "files", ())]


def note_files(agent: Any, settings: Mapping[str, Any] | None, note: Callable[[str], None]) -> None:
    """Notes the settings, given or by default, that are files and not among those that the agent names as its own.

    Agents of dohyo have none. One of another package may read weights, which its records do not tell from new ones.
    """
    parts = parts_of(agent)
    foreign = [type(part) for part in parts if not type(part).__module__.startswith("dohyo.")]
    if not foreign:
        return
    values = {name: value for kind in foreign for name, value in _defaults(kind).items()} | dict(settings or {})
    named = {os.path.realpath(file) for file in files_of(parts)}
    for name, value in values.items():
        if _is_file(value) and os.path.realpath(value) not in named:
            note(
                f"agent '{agent.spec.name}': setting '{name}' is a file that its record does not name; list it in "
                "`files`, or a run with new weights is taken for the old one"
            )


def _defaults(kind: type) -> dict[str, Any]:
    try:
        return {one.name: one.default for one in inspect.signature(kind).parameters.values()}
    except (TypeError, ValueError):  # a constructor without a signature
        return {}


def _is_file(value: Any) -> bool:
    return isinstance(value, str | Path) and os.path.isfile(value)  # unlike Path's, it takes any text
