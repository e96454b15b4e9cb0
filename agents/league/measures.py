"""Measures: what rows of the league hold, by the family of the discipline, and how it is shown."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from dohyo.evaluation.families import Family


@dataclass(frozen=True, slots=True)
class Measure:
    """A measure of the rows.

    Attributes:
        title: Name for people, with its unit.
        families: Families whose rows have it.
        lower: Whether lower values are better.
        share: Whether a drive of one vehicle has 0 or 100.
        digits: Decimals.
    """

    title: str
    families: tuple[Family, ...]
    lower: bool = False
    share: bool = False
    digits: int = 1


_DRIVING: Final = (Family.DRIVING,)
_PARKING: Final = (Family.PARKING,)
_FORECASTING: Final = (Family.FORECASTING,)
_FREEWAY: Final = (Family.FREEWAY,)

MEASURES: Final[Mapping[str, Measure]] = {
    "driving_score": Measure("driving score", _DRIVING),
    "nocrash_success": Measure("success without a collision, %", _DRIVING, share=True),
    "success": Measure("success, %", _DRIVING + _PARKING, share=True),
    "route_completion": Measure("route completion, %", _DRIVING),
    "irs": Measure("infraction rate score", _DRIVING),
    "closed_loop": Measure("closed-loop score", _DRIVING),
    "aligned": Measure("aligned, % of those parked, mean over lots", _PARKING, share=True),
    "time_s": Measure("time, s", _PARKING, lower=True),
    "mse": Measure("MSE x 1000", _FORECASTING, lower=True, digits=2),
    "speed_std_mps": Measure("deviation of all speeds, m/s", _FREEWAY, lower=True, digits=2),
    "throughput_vph": Measure("throughput, vehicles/h", _FREEWAY, digits=0),
}


def measures_of(family: Family) -> list[str]:
    """Names of the measures of a family."""
    return [name for name, one in MEASURES.items() if family in one.families]
