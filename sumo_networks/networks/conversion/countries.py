"""Countries: the side on which traffic drives, and the speed limits where no sign stands."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import reverse_geocode

from dohyo.sumo_networks.errors import UnknownNameError

OTHER = "other"
"""Country of a place that is not known: traffic on the right, and the most frequent limits."""


@dataclass(frozen=True, slots=True)
class Country:
    """Traffic rules of a country.

    Attributes:
        code: Its two letters (ISO 3166-1), or `OTHER`.
        left_hand: Whether traffic drives on the left.
        town_kmh: Speed limit in towns without a sign, km/h.
        motorway_kmh: Speed limit on motorways without a sign, km/h.
    """

    code: str
    left_hand: bool
    town_kmh: int
    motorway_kmh: int

    @property
    def summary(self) -> str:
        """The rules, for people."""
        side = "left" if self.left_hand else "right"
        return f"traffic on the {side}; without a sign {self.town_kmh} km/h, on motorways {self.motorway_kmh} km/h"


def country_named(code: str) -> Country:
    """Traffic rules of a country.

    Args:
        code: Two letters, such as "GB".

    Raises:
        UnknownNameError: No country has these letters.
    """
    code = code.upper()
    if code not in _codes():
        raise UnknownNameError("country", code, _codes())
    return _country(code)


def country_at(latitude: float, longitude: float) -> Country:
    """Country of the town that is nearest to a place, given in degrees."""
    return _country(reverse_geocode.get((latitude, longitude))["country_code"])


def unknown_country() -> Country:
    """Rules for a place that is not known."""
    return _country(OTHER)


def _country(code: str) -> Country:
    table = _table()
    limits = table["limits_kmh"].get(code, table["limits_kmh"][OTHER])
    return Country(code, code in table["left_hand"], limits["town"], limits["motorway"])


@lru_cache(maxsize=1)
def _table() -> dict[str, Any]:
    return tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))


@lru_cache(maxsize=1)
def _codes() -> list[str]:
    """Two letters of every country."""
    lines = (Path(reverse_geocode.__file__).parent / "countries.csv").read_text(encoding="utf-8").splitlines()
    return sorted({line.split(",")[0] for line in lines})
