"""Plans: what drivers of a live world intend, as they sent it beside their decisions; shown, and nothing else."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import msgspec

from dohyo.sumo_networks.errors import InvalidInputError

Points = Sequence[tuple[float, float]]
"""Points ahead in the ego's frame, m."""


@dataclass(slots=True)
class Plans:
    """The last plan of each ego, with the tick at which it was made."""

    _plans: dict[str, tuple[int, Points]] = field(default_factory=dict)
    _changed: bool = False

    @staticmethod
    def check(given: Mapping[str, Points], egos: Sequence[str], farthest_m: float) -> None:
        """Checks the plans of a place.

        Args:
            given: Plans by ego.
            egos: Egos of the place.
            farthest_m: Largest coordinate, m.

        Raises:
            InvalidInputError: A plan is of another ego, or a point is no place near it.
        """
        if unknown := sorted(set(given) - set(egos)):
            raise InvalidInputError(f"plans: expected those of {list(egos)} only, got {unknown[:10]} too")
        for ego, points in given.items():
            if not all(math.isfinite(one) and abs(one) <= farthest_m for point in points for one in point):
                raise InvalidInputError(f"plans: '{ego}': expected points within {farthest_m:g} m of the ego")

    def take(self, given: Mapping[str, Points], tick: int) -> None:
        """Takes plans that were checked, which are made at a tick."""
        self._plans |= {ego: (tick, points) for ego, points in given.items()}
        self._changed |= bool(given)

    def forget(self, egos: Iterable[str]) -> None:
        """Forgets the plans of egos that have another driver from now on."""
        for ego in egos:
            self._changed |= self._plans.pop(ego, None) is not None

    def news(self) -> bytes | None:
        """All plans as JSON, {ego: {tick, points}}; None where nothing has changed since the last call."""
        if not self._changed:
            return None
        self._changed = False
        return msgspec.json.encode(
            {ego: {"tick": tick, "points": points} for ego, (tick, points) in self._plans.items()}
        )
