"""One file per infraction; each criterion watches one ego for one episode."""

from __future__ import annotations

from dohyo.evaluation.criteria.base import ENDS, Criterion
from dohyo.evaluation.criteria.blocked import Blocked
from dohyo.evaluation.criteria.collision import Collision
from dohyo.evaluation.criteria.minimum_speed import MinimumSpeed
from dohyo.evaluation.criteria.outside_lanes import OutsideLanes
from dohyo.evaluation.criteria.red_light import RedLight
from dohyo.evaluation.criteria.route_deviation import RouteDeviation
from dohyo.evaluation.criteria.scenario_timeout import ScenarioTimeout
from dohyo.evaluation.criteria.stop_sign import StopSign
from dohyo.evaluation.criteria.timeout import RouteTimeout
from dohyo.evaluation.criteria.yielding import Yielding
from dohyo.sumo_networks.scenario import Scenario

__all__ = [
    "ENDS",
    "Blocked",
    "Collision",
    "Criterion",
    "MinimumSpeed",
    "OutsideLanes",
    "RedLight",
    "RouteDeviation",
    "RouteTimeout",
    "ScenarioTimeout",
    "StopSign",
    "Yielding",
    "criteria_for",
]


def criteria_for(scenario: Scenario) -> tuple[Criterion, ...]:
    """Fresh instances of all criteria, for one ego of a scenario."""
    return (
        Collision(),
        RedLight(),
        StopSign(),
        OutsideLanes(),
        MinimumSpeed(),
        ScenarioTimeout(),
        Yielding(),
        RouteDeviation(),
        Blocked(),
        RouteTimeout(limit_s=scenario.time_limit_s),
    )
