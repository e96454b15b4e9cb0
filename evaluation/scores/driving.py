"""Driving score: route completion, infraction penalty, their product, and the infraction rate score.

Pure functions of one ego's record. Every collision infraction of the record counts, at fault or not, as in CARLA. The
collision criterion has already left out the collisions of a standing ego.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Final, Literal, get_args

from dohyo.evaluation.records.record import EgoRecord, Infraction
from dohyo.evaluation.records.specifications import InfractionKind
from dohyo.sumo_networks.errors import InvalidInputError

Rules = Literal["1.0", "2.0", "2.1"]
IrsLength = Literal["completed", "driven", "route"]

MOST_OUTSIDE: Final = 0.25
"""Largest share of a drive outside the lanes that is a success: a detour round an obstacle on a short route is less."""
MIN_KM: Final = 0.001
"""Smallest distance that a score divides by, km."""


def route_completion(ego: EgoRecord) -> float:
    """Route completion RC, percent in [0, 100].

    RC = 100 if the goal was reached, else 100 * progress / route length, kept strictly below 100: an ego that stopped
    before its goal has not completed its route. Source: CARLA Leaderboard.

    Raises:
        InvalidInputError: If progress or route length is not finite.
    """
    if ego.status.completed:
        return 100.0
    percent = 100.0 * _finite(ego.progress_m, "progress_m") / _finite(ego.route_length_m, "route_length_m")
    return min(percent, math.nextafter(100.0, 0.0))


def route_km(ego: EgoRecord) -> float:
    """Kilometres of the route completed: route length * RC / 100.

    Raises:
        InvalidInputError: If progress or route length is not finite.
    """
    return _finite(ego.route_length_m, "route_length_m") * route_completion(ego) / 100_000.0


def outside_fraction(ego: EgoRecord) -> float:
    """Metres driven with the centre outside the lanes per metre of route completed, at most 1; 0 if there are none.

    Metres of detours and circles are in no denominator, so that they dilute nothing. Source: CARLA Leaderboard
    ("outside route lanes"), which divides by the completed metres of the route.

    Raises:
        InvalidInputError: If a distance is not finite.
    """
    outside_m, completed_m = _finite(ego.outside_lanes_m, "outside_lanes_m"), 1000.0 * route_km(ego)
    return outside_m / completed_m if outside_m < completed_m else float(outside_m > 0.0)


def kept_to_the_lanes(ego: EgoRecord) -> bool:
    """Whether *outside* is at most `MOST_OUTSIDE`, see `outside_fraction`; no success counts otherwise.

    Nothing solid stands beside the roads here: an ego on the verge would meet neither traffic nor lights.

    Raises:
        InvalidInputError: If a distance is not finite.
    """
    return outside_fraction(ego) <= MOST_OUTSIDE


def infraction_penalty(infractions: Iterable[Infraction], rules: Rules, outside_fraction: float) -> float:
    """Infraction penalty IP in [0, 1]; 1 without any infraction.

    Rules 1.0 and 2.0: IP = (1 - outside) * prod(p), one factor p per infraction.
    Rules 2.1: IP = (1 - outside) / (1 + sum(c)), one cost c per infraction.
    The specification of a kind (`InfractionKind.specification`) gives its factor, its cost and the first rules that
    have it; an infraction that ends the route has neither factor nor cost. Source: CARLA Leaderboard 1.0, 2.0, 2.1.

    Args:
        infractions: Infractions of one ego. OUTSIDE_LANES is ignored here, since it enters as a distance.
        rules: Version of the leaderboard's rules.
        outside_fraction: Metres outside the lanes per metre of route completed, [0, 1].

    Raises:
        InvalidInputError: If the rules are unknown, or a number is NaN or out of its range.
    """
    if rules not in get_args(Rules):
        raise InvalidInputError(f"expected rules {', '.join(get_args(Rules))}, got {rules!r}")
    if not 0.0 <= outside_fraction <= 1.0:
        raise InvalidInputError(f"expected an outside fraction in [0, 1], got {outside_fraction}")
    counted = [one for one in infractions if _is_known(one.kind, rules)]
    if rules == "2.1":
        return (1.0 - outside_fraction) / (1.0 + math.fsum(_cost(one) for one in counted))
    return (1.0 - outside_fraction) * math.prod(sorted(_factor(one) for one in counted))


def driving_score(ego: EgoRecord, rules: Rules) -> float:
    """Driving score DS = RC * IP, percent in [0, 100]. Source: CARLA Leaderboard.

    Raises:
        InvalidInputError: If the rules are unknown or a number is NaN.
    """
    return route_completion(ego) * infraction_penalty(ego.infractions, rules, outside_fraction(ego))


def infraction_rate_score(ego: EgoRecord, lambda_: float = 4.0, length: IrsLength = "completed") -> float:
    """Infraction rate score, percent in [0, 100]: the driving score made independent of the route's length.

    IRS = RC * (1 - outside) * prod_i exp(-lambda * (n_i / L) * (1 - p_i)), with n_i infractions of kind i, p_i their
    factors under rules 2.0 and L in km, at least 0.001 km. Source: Coelho 2024.

    The thesis does not say how driving outside the lanes enters. Here it keeps the driving score's factor,
    (1 - outside). That share is already a rate, so IRS does not change if a route and its infractions double.

    Args:
        ego: Record of the drive.
        lambda_: Decay rate, km per infraction.
        length: Meaning of L: "completed", route length * RC, as in CARLA's rates; "driven", the distance driven, which
            circles dilute (consistent with the thesis's table); or "route", the length of the route (its text).

    Raises:
        InvalidInputError: If lambda is negative, the length unknown, or a number NaN.
    """
    if length not in get_args(IrsLength):
        raise InvalidInputError(f"expected IRS length {', '.join(get_args(IrsLength))}, got {length!r}")
    if not 0.0 <= lambda_ < math.inf:
        raise InvalidInputError(f"expected a finite lambda of at least 0, got {lambda_}")
    lengths_km = {"completed": route_km(ego), "driven": ego.driven_m / 1000.0, "route": ego.route_length_m / 1000.0}
    km = max(MIN_KM, _finite(lengths_km[length], f"{length} length"))
    weight = math.fsum(1.0 - _factor(one) for one in ego.infractions)
    return route_completion(ego) * (1.0 - outside_fraction(ego)) * math.exp(-lambda_ * weight / km)


def _is_known(kind: InfractionKind, rules: Rules) -> bool:
    """Whether a version of the rules has a kind of infraction."""
    versions = get_args(Rules)
    return versions.index(kind.specification.since) <= versions.index(rules)


def _factor(infraction: Infraction) -> float:
    """Factor in (0, 1] of one infraction under rules 2.0."""
    penalty = infraction.kind.specification.penalty
    return penalty.factor_of(_magnitude(infraction)) if penalty else 1.0


def _cost(infraction: Infraction) -> float:
    """Cost, at least 0, of one infraction under rules 2.1."""
    penalty = infraction.kind.specification.penalty
    return penalty.cost_of(_magnitude(infraction)) if penalty else 0.0


def _magnitude(infraction: Infraction) -> float:
    return _finite(infraction.magnitude, f"magnitude of {infraction.kind}")


def _finite(value: float, what: str) -> float:
    if not math.isfinite(value):
        raise InvalidInputError(f"expected a finite {what}, got {value}")
    return value
