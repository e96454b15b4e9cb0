"""Mixed runs by agent: the scores of each one over its own drives, and which agents met."""

from __future__ import annotations

from typing import Any

from dohyo.evaluation.meetings import count_meetings
from dohyo.service.boards.leaderboard import Driver, Entry
from dohyo.service.evaluations.scoring import Drive, lost_episodes, summarise_drives


def drivers_of(entry: Entry) -> list[Driver]:
    """All drivers of a run, each once, its own first."""
    return list(dict.fromkeys([entry.driver, *entry.others.values()]))


def agents_document(entry: Entry) -> list[dict[str, Any]]:
    """Scores of each agent of a mixed run, as plain JSON; none of a run of one agent."""
    if not entry.others:
        return []
    return [_agent(entry, driver) for driver in drivers_of(entry)]


def meetings_document(entry: Entry) -> list[dict[str, Any]]:
    """Every pair of agents of a mixed run with a common episode, as plain JSON; none of a run of one agent."""
    drivers = drivers_of(entry)
    episodes: dict[str, list[Drive]] = {}
    for drive in entry.drives:
        episodes.setdefault(drive.episode, []).append(drive)
    met = count_meetings(
        (
            {drive.ego: drivers.index(entry.driver_of(drive.ego)) for drive in drives},
            {drive.ego: drive.facts.get("hits", {}) for drive in drives},
        )
        for drives in episodes.values()
    )
    return [
        {
            "agents": [{"agent": one.agent, "version": one.version} for one in (drivers[m.agent], drivers[m.other])],
            "episodes": m.episodes,
            "collisions": m.collisions,
        }
        for m in met
    ]


def _agent(entry: Entry, driver: Driver) -> dict[str, Any]:
    drives, gridlocked = (
        [drive for drive in some if entry.driver_of(drive.ego) == driver] for some in (entry.drives, entry.gridlocked)
    )
    return {
        "agent": driver.agent,
        "version": driver.version,
        "submission": driver.submission,
        "kind": driver.kind,
        "track": driver.track,
        "egos": list(dict.fromkeys(drive.ego for drive in drives)),
        **summarise_drives(drives, lost_episodes(entry.lost_of(driver), gridlocked)),
    }
