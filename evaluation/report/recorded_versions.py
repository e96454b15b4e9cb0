"""Versions of dohyo and SUMO that the records of a report mix."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from dohyo.evaluation.records.record import EpisodeRecord

DIFFERENT = "different versions drove these episodes, which alone may change scores."


def dohyo_versions(records: Iterable[EpisodeRecord]) -> str:
    """Versions of dohyo that drove the episodes, such as "0.9.0, 1.0.0"."""
    return _listed(record.versions.dohyo for record in records)


def sumo_versions(records: Iterable[EpisodeRecord]) -> str:
    """Versions of SUMO that drove the episodes."""
    return _listed(record.versions.sumo.removeprefix("SUMO ") for record in records)


def mixed_versions(agents: Sequence[tuple[str, Sequence[EpisodeRecord]]]) -> str:
    """Sentence that names the versions behind each agent, if they are not all the same; else ""."""
    found = {(record.versions.dohyo, record.versions.sumo) for _, records in agents for record in records}
    if len(found) < 2:
        return ""
    by_agent = "; ".join(
        f"{name}: dohyo {dohyo_versions(records)}, SUMO {sumo_versions(records)}" for name, records in agents
    )
    return f"{DIFFERENT} {by_agent}"


def _listed(values: Iterable[str]) -> str:
    return ", ".join(sorted(set(values)))
