"""One drive of a study: what its record counts, and the work of RSS and the rules, which no record holds."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from dohyo.agents.safety.rss_monitor import STANDS_M_S
from dohyo.agents.studies.rows import Row
from dohyo.evaluation.agent import Agent, Observation
from dohyo.evaluation.episode.runner import drive_episode
from dohyo.evaluation.records.record import EgoRecord
from dohyo.evaluation.records.specifications import Status
from dohyo.evaluation.scores.nocrash import drove, success
from dohyo.sumo_networks.errors import SimulationError
from dohyo.sumo_networks.scenario import Scenario
from dohyo.sumo_networks.units import TICK_S

DEADLOCK_S = 30.0
"""Standing time in critical intervals at the end that makes a blocked or late drive a deadlock, s."""
LOOKS_S = 1.0


class Stand:
    """Present standing time of an ego in critical intervals, sampled once a second.

    Attributes:
        seconds: The standing time.
    """

    def __init__(self, agent: Agent) -> None:
        self._agent = agent
        self.seconds = 0.0

    def look(self, tick: int, observations: Mapping[str, Observation]) -> None:
        """Updates; called in every tick before the agent acts."""
        if tick % round(LOOKS_S / TICK_S):
            return
        stands = all(float(seen["speedometer"][0]) < STANDS_M_S for seen in observations.values())
        self.seconds = self.seconds + LOOKS_S if stands and judgement(self._agent).get("critical") else 0.0


def drive(agent: Agent, scenario: Scenario) -> Row:
    """Drives one scenario; measures of the row.

    Raises:
        SimulationError: The simulation failed.
    """
    stand = Stand(agent)
    record, _ = drive_episode(scenario, {scenario.missions[0].name: agent}, show=stand.look)
    ego = record.egos[0]
    if ego.status.worth_another_try:
        raise SimulationError(ego.failure or ego.status.value)
    return measures(scenario, ego) | under_rules(ego.status, agent, stand.seconds)


def measures(scenario: Scenario, ego: EgoRecord) -> Row:
    """What the record of a drive counts."""
    return {
        "cell": scenario.cell,
        "event": scenario.events[0].kind if scenario.events else None,
        "status": ego.status.value,
        "success": success(ego),
        "drove_2500m": drove(ego) if ego.route_length_m >= 2500.0 else None,
        "progress": round(ego.progress_m / ego.route_length_m, 4),
        "infractions": [one.kind.value for one in ego.infractions],
        "duration_s": ego.duration_s,
    }


def under_rules(status: Status, agent: Agent, stood_s: float) -> Row:
    """Results of RSS and the rules in a drive; empty if RSS did not monitor it.

    Args:
        status: Of the drive.
        agent: After the drive.
        stood_s: Standing time in critical intervals at the end.
    """
    judged = judgement(agent)
    if not judged:
        return {}
    kept = {name: judged[name] for name in ("critical_share", "longest_standing_s")}
    return kept | {"deadlock": status in (Status.BLOCKED, Status.TIMED_OUT) and stood_s >= DEADLOCK_S}


def judgement(agent: Agent) -> Mapping[str, Any]:
    """What RSS says of the present; empty without RSS."""
    judged: Mapping[str, Any] = (agent.explain() or {}).get("rss", {})
    return judged
