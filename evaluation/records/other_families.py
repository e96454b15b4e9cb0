"""Records without drives on roads, told by their keys: their hashes cover other facts, so they are recognised first."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from dohyo.sumo_networks.errors import InvalidInputError


def check_has_drives(document: Mapping[str, Any], path: str) -> None:
    """Checks that a record is not one of parking, of the freeway or of forecasts.

    Args:
        document: Content of the record's file.
        path: Name of the file in messages.

    Raises:
        InvalidInputError: It is such a record.
    """
    if (found := _other_family(document)) is not None:
        what, works = found
        raise InvalidInputError(f"{path}: {what}; it has no drives on roads: {works}")


def _other_family(document: Mapping[str, Any]) -> tuple[str, str] | None:
    """What a record is, and the commands that read it; None where it looks like one of drives on roads."""
    at_service = "`dohyo verify` checks it, and `dohyo evaluations watch ID` prints the scores"
    if "karts" in document and "motion_sha256" in document:
        return "a parking lot", "`dohyo verify` checks it, and `dohyo report FOLDER` has the scores"
    if "plans" in document and "egos" not in document:
        return "a morning on the freeway", at_service
    if "forecasts_sha256" in document:
        return "a day of forecasts", at_service
    if "reference_units" in document:
        return "a result of `dohyo evaluate` on the freeway", "report.html beside it has the scores"
    return None
