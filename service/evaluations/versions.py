"""Versions of dohyo that drove an evaluation: noted with its records, and put in order.

The simulation or the judgement may change with the version, so that drives of two versions are not comparable.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping
from typing import Any, Final

from sqlalchemy.orm import Session

from dohyo.service.evaluations.model import Evaluation

EARLIER: Final = "earlier"
"""Stands for the versions of drives from before the service noted versions."""
_RELEASE: Final = re.compile(r"(\d+(?:\.\d+)*)(.*)")


def note_version(session: Session, evaluation_id: str, summary: Mapping[str, Any]) -> None:
    """Adds the version that drove an episode to those of its evaluation, whose row this transaction has locked."""
    evaluation, version = session.get_one(Evaluation, evaluation_id), summary.get("dohyo")
    if version is not None and version not in evaluation.dohyo_versions:
        evaluation.dohyo_versions = [*evaluation.dohyo_versions, version]


def newest(versions: Collection[str]) -> str | None:
    """The newest of some versions; None without any."""
    return max(versions, key=version_order, default=None)


def version_order(version: str) -> tuple[tuple[int, ...], bool, str]:
    """Sorts versions as PEP 440 does: a pre-release is older than its release, and `EARLIER` older than all."""
    found = _RELEASE.fullmatch(version)
    if found is None:
        return (), False, version
    release, rest = found.groups()
    return tuple(int(number) for number in release.split(".")), not rest, rest
