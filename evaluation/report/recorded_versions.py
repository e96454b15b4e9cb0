"""Versions of dohyo and SUMO that the records of a report mix."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from dohyo.evaluation.records.record import EpisodeRecord
from dohyo.evaluation.report.contenders import Evaluation

DIFFERENT = "different versions drove these episodes, which alone may change scores."


def dohyo_versions(records: Iterable[EpisodeRecord]) -> str:
    """Versions of dohyo that drove the episodes, such as "0.9.0, 1.0.0"."""
    return _listed(record.versions.dohyo for record in records)


def sumo_versions(records: Iterable[EpisodeRecord]) -> str:
    """Versions of SUMO that drove the episodes."""
    return _listed(record.versions.sumo.removeprefix("SUMO ") for record in records)


def mixed_versions(evaluations: Sequence[Evaluation]) -> str:
    """Sentence that names the versions behind each agent, if they are not all the same; else ""."""
    found = {(record.versions.dohyo, record.versions.sumo) for one in evaluations for record in one.records}
    if len(found) < 2:
        return ""
    by_agent = "; ".join(
        f"{one.agent}: dohyo {dohyo_versions(one.records)}, SUMO {sumo_versions(one.records)}" for one in evaluations
    )
    return f"{DIFFERENT} {by_agent}"


def _listed(values: Iterable[str]) -> str:
    return ", ".join(sorted(set(values)))
