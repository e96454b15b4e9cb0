"""Driving score: route completion, infraction penalty, their product, and the infraction rate score.

Pure functions of one ego's record. Every collision infraction of the record counts, at fault or not, as in CARLA: the
collision criterion has already left out those of a standing ego.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from types import MappingProxyType
from typing import Final, Literal, get_args

from dohyo.evaluation.records.record import EgoRecord, Infraction, InfractionKind
from dohyo.sumo_networks.errors import InvalidInputError

Rules = Literal["1.0", "2.0", "2.1"]
IrsLength = Literal["driven", "route"]

MIN_KM: Final = 0.001
"""Floor of every distance that something is divided by, km."""

_FACTORS: Final[Mapping[InfractionKind, float]] = MappingProxyType(
    {
        InfractionKind.COLLISION_PEDESTRIAN: 0.50,
        InfractionKind.COLLISION_VEHICLE: 0.60,
        InfractionKind.COLLISION_STATIC: 0.65,
        InfractionKind.RED_LIGHT: 0.70,
        InfractionKind.STOP_SIGN: 0.80,
        InfractionKind.SCENARIO_TIMEOUT: 0.70,
        InfractionKind.YIELD_EMERGENCY: 0.70,
    }
)
_COSTS: Final[Mapping[InfractionKind, float]] = MappingProxyType(
    {
        InfractionKind.COLLISION_PEDESTRIAN: 1.0,
        InfractionKind.COLLISION_VEHICLE: 0.7,
        InfractionKind.COLLISION_STATIC: 0.6,
        InfractionKind.RED_LIGHT: 0.4,
        InfractionKind.STOP_SIGN: 0.25,
        InfractionKind.SCENARIO_TIMEOUT: 0.4,
        InfractionKind.YIELD_EMERGENCY: 0.4,
    }
)
_SINCE_2_0: Final = frozenset(
    {InfractionKind.MINIMUM_SPEED, InfractionKind.SCENARIO_TIMEOUT, InfractionKind.YIELD_EMERGENCY}
)
_MINIMUM_SPEED_WEIGHT: Final = 0.3
_MINIMUM_SPEED_COST: Final = 0.4


def route_completion(ego: EgoRecord) -> float:
    """Route completion RC, percent in [0, 100].

    RC = 100 where the goal was reached, else 100 * progress / route length, kept strictly below 100: an ego that
    stopped short of its goal has not completed its route. Source: CARLA Leaderboard.

    Raises:
        InvalidInputError: If progress or route length is not finite.
    """
    if ego.status.completed:
        return 100.0
    percent = 100.0 * _finite(ego.progress_m, "progress_m") / _finite(ego.route_length_m, "route_length_m")
    return min(percent, math.nextafter(100.0, 0.0))


def outside_fraction(ego: EgoRecord) -> float:
    """Share in [0, 1] of the driven distance with the centre outside the lanes; 0 for an ego that never moved.

    Source: CARLA Leaderboard ("outside route lanes", metres outside per metre traversed).

    Raises:
        InvalidInputError: If either distance is not finite.
    """
    outside_m, driven_m = _finite(ego.outside_lanes_m, "outside_lanes_m"), _finite(ego.driven_m, "driven_m")
    return min(1.0, outside_m / driven_m) if driven_m > 0.0 else 0.0


def infraction_penalty(infractions: Iterable[Infraction], rules: Rules, outside_fraction: float) -> float:
    """Infraction penalty IP in [0, 1]; 1 without any infraction.

    Rules 1.0 and 2.0: IP = (1 - outside) * prod(p), one factor p per infraction: pedestrian 0.50, vehicle 0.60, static
    object 0.65, red light 0.70, stop sign 0.80; since 2.0 also scenario timeout 0.70, not yielding to an emergency
    vehicle 0.70, and 1 - 0.3 * (1 - s) per minimum-speed checkpoint missed, s being the share of the surrounding
    traffic's speed.
    Rules 2.1: IP = (1 - outside) / (1 + sum(c)), one cost c per infraction: 1.0, 0.7, 0.6, 0.4, 0.25, 0.4, 0.4 in the
    same order, and 0.4 * (1 - s).
    Deviation, blocking and time-out end the route and carry no factor. Source: CARLA Leaderboard 1.0, 2.0, 2.1.

    Args:
        infractions: Of one ego. Their OUTSIDE_LANES events are not read: that infraction enters as a distance.
        rules: Version of the leaderboard's rules.
        outside_fraction: Share of the driven distance outside the lanes, [0, 1].

    Raises:
        InvalidInputError: If the rules are unknown, or a number is NaN or out of its range.
    """
    if rules not in get_args(Rules):
        raise InvalidInputError(f"expected rules {', '.join(get_args(Rules))}, got {rules!r}")
    if not 0.0 <= outside_fraction <= 1.0:
        raise InvalidInputError(f"expected an outside fraction in [0, 1], got {outside_fraction}")
    if rules == "2.1":
        return (1.0 - outside_fraction) / (1.0 + math.fsum(_cost(one) for one in infractions))
    counted = (one for one in infractions if rules == "2.0" or one.kind not in _SINCE_2_0)
    return (1.0 - outside_fraction) * math.prod(sorted(_factor(one) for one in counted))


def driving_score(ego: EgoRecord, rules: Rules) -> float:
    """Driving score DS = RC * IP, percent in [0, 100]. Source: CARLA Leaderboard.

    Raises:
        InvalidInputError: If the rules are unknown or a number is NaN.
    """
    return route_completion(ego) * infraction_penalty(ego.infractions, rules, outside_fraction(ego))


def infraction_rate_score(ego: EgoRecord, lambda_: float = 4.0, length: IrsLength = "driven") -> float:
    """Infraction rate score, percent in [0, 100]: the driving score made independent of the route's length.

    IRS = RC * (1 - outside) * prod_i exp(-lambda * (n_i / L) * (1 - p_i)), with n_i infractions of kind i, p_i their
    factors under rules 2.0 and L in km, at least 0.001 km. Source: Coelho 2024.

    The thesis leaves open how leaving the lanes enters. Here it keeps the driving score's factor, (1 - outside): that
    share is already a rate, so IRS stays what it was when a route and its infractions double.

    Args:
        ego: The drive.
        lambda_: Decay, km per infraction.
        length: What L is: "driven", the distance driven (consistent with the thesis's table), or "route", the route's
            length (the thesis's text).

    Raises:
        InvalidInputError: If lambda is negative, the length unknown, or a number NaN.
    """
    if length not in get_args(IrsLength):
        raise InvalidInputError(f"expected IRS length {' or '.join(get_args(IrsLength))}, got {length!r}")
    if not 0.0 <= lambda_ < math.inf:
        raise InvalidInputError(f"expected a finite lambda of at least 0, got {lambda_}")
    length_m = ego.driven_m if length == "driven" else ego.route_length_m
    km = max(MIN_KM, _finite(length_m, f"{length} length") / 1000.0)
    weight = math.fsum(1.0 - _factor(one) for one in ego.infractions)
    return route_completion(ego) * (1.0 - outside_fraction(ego)) * math.exp(-lambda_ * weight / km)


def _factor(infraction: Infraction) -> float:
    """Factor in (0, 1] of one infraction under rules 2.0."""
    if infraction.kind is InfractionKind.MINIMUM_SPEED:
        return 1.0 - _MINIMUM_SPEED_WEIGHT * _missing_speed(infraction)
    return _FACTORS.get(infraction.kind, 1.0)


def _cost(infraction: Infraction) -> float:
    """Cost, at least 0, of one infraction under rules 2.1."""
    if infraction.kind is InfractionKind.MINIMUM_SPEED:
        return _MINIMUM_SPEED_COST * _missing_speed(infraction)
    return _COSTS.get(infraction.kind, 0.0)


def _missing_speed(infraction: Infraction) -> float:
    """Share in [0, 1] by which the ego was slower than the surrounding traffic."""
    percent = _finite(infraction.magnitude, "magnitude of minimum_speed")
    return 1.0 - min(max(percent, 0.0), 100.0) / 100.0


def _finite(value: float, what: str) -> float:
    if not math.isfinite(value):
        raise InvalidInputError(f"expected a finite {what}, got {value}")
    return value
