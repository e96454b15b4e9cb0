"""Views: which parts of the state each policy sees."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from dohyo.agents.hierarchical.options.manoeuvres import DRIVE, Manoeuvre
from dohyo.agents.hierarchical.state.state import StateEncoder
from dohyo.sumo_networks.arrays import IntArray

_WAY = ("waypoints", "deviation", "limits", "motion")
PARTS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        Manoeuvre.LANE: ("z", "strips", "distances", "allowances", *_WAY),
        Manoeuvre.LEFT: ("z", "strips", *_WAY),
        Manoeuvre.RIGHT: ("z", "strips", *_WAY),
        Manoeuvre.BRAKING: ("z", "strips", "crossings", "distances", "allowances", *_WAY),
        Manoeuvre.LIGHTS: ("z", "strips", "junctions", "crossings", "distances", "allowances", *_WAY),
        DRIVE: ("z", "actors", "strips", "junctions", "crossings", "distances", "allowances", *_WAY),
    }
)
"""By `Manoeuvre`, or "drive": names of `StateEncoder.layout`, of which a state has only some. No policy sees the place,
since no action depends on it. No sub-policy sees `actors`: from the few hundred episodes of an imitation, it learns
more without them."""


def rows_seen(encoder: StateEncoder, what: str) -> IntArray:
    """Indices of the numbers of a state that a policy sees.

    Args:
        encoder: Makes the states.
        what: A `Manoeuvre`, or "drive".
    """
    parts = [encoder.layout[name] for name in PARTS[what] if name in encoder.layout]
    return np.concatenate([np.arange(part.start, part.stop) for part in parts])
