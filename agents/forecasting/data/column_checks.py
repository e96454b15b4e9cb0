"""Checks of columns: one that its name calls another quantity than a speed is refused, one that may be is told."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from dohyo.agents.forecasting.data.speed_table import FREE_MPS, UNITS
from dohyo.sumo_networks.arrays import Float32Array
from dohyo.sumo_networks.errors import InvalidInputError

SPEEDS = frozenset({"speed", "speeds", "velocity", "velocities", "v", "kmh", "kph", "mph"})
QUANTITIES = frozenset(
    {"flow", "flows", "volume", "volumes", "count", "counts", "occupancy", "occupancies", "occ", "density", "headway"}
)
"""Words for what is no speed; they may be in the name of a place, such as 'Flow Road'."""
BESIDE = frozenset(
    {"lane", "detector", "det", "sensor", "loop", "station", "segment", "vehicle", "vehicles", "veh", "car", "cars"}
    | {"truck", "trucks", "traffic", "total", "sum", "mean", "average", "avg", "rate", "number", "percent", "per", "h"}
)
"""Words beside these that name no place."""
LABELS = frozenset({"lane", "lanes", "id"})
"""Whole names of columns that number something; 'lane 1' may be the speed there."""
MANY = 5
"""Most columns that are all named."""


def check_names(names: Sequence[str], where: str, trusted: bool) -> tuple[str, ...]:
    """Notes about columns whose names may be those of other quantities.

    Args:
        names: As the file has them.
        where: Path, for the message.
        trusted: Whether no name is refused.

    Raises:
        InvalidInputError: A name says that the column holds something else.
    """
    words = {name: _words(name) for name in names}
    others = [name for name in names if words[name] & QUANTITIES and not words[name] & SPEEDS]
    clear = [name for name in others if words[name] <= QUANTITIES | BESIDE]
    if clear and not trusted:
        raise InvalidInputError(
            f"'{where}': expected columns of speeds alone, got '{clear[0]}' ({len(clear)} of {len(names)} columns are "
            "other quantities by their names); remove or rename such columns; if they are speeds: --trust-unit"
        )
    told = [name for name in names if name in others or name.strip().lower() in LABELS]
    return (f"no speeds by their names, but read as such: {_listed(told)}",) if told else ()


def segments_note(names: Sequence[str]) -> str:
    """Which columns were taken as segments."""
    return f"{len(names)} column{'s are segments' if len(names) > 1 else ' is a segment'}: {_listed(names)}"


def slow_notes(speeds: Float32Array, names: Sequence[str], unit: str) -> tuple[str, ...]:
    """A note about columns that no vehicle passes at an ordinary speed: congestion throughout, or other quantities.

    Args:
        speeds: (T, N), m/s, with a value in each column.
        names: Of the columns.
        unit: In which they were read.
    """
    fastest = np.nanquantile(speeds, 0.95, axis=0)
    slow, slowest = int((fastest < FREE_MPS[0]).sum()), int(fastest.argmin())
    if not slow:
        return ()
    return (
        f"the free speed of '{names[slowest]}' (95 % of the values are below it) is "
        f"{float(fastest[slowest]) / UNITS[unit]:.3g} {unit}, expected {3.6 * FREE_MPS[0]:.0f} km/h or more "
        f"({slow} of {len(names)} columns are slower): congested throughout, or no speeds?",
    )


def _words(name: str) -> frozenset[str]:
    """Words of a name in small letters, without what stands in brackets."""
    bare = re.sub(r"\(.*?\)|\[.*?\]", " ", name)
    return frozenset(re.findall(r"[^\W\d_]+", re.sub(r"(?<=[a-z])(?=[A-Z])", " ", bare).lower()))


def _listed(names: Sequence[str]) -> str:
    """Names, shortened where there are many."""
    return ", ".join(names if len(names) <= MANY else [*names[:3], "...", names[-1]])
