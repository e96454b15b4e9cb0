"""NoCrash: any collision infraction fails the drive, even if the ego did not cause it.

Contacts of a standing ego are no infractions, so they do not fail it. A drive beside the road does.
"""

from __future__ import annotations

from dohyo.evaluation.records.record import EgoRecord, Infraction
from dohyo.evaluation.records.specifications import COLLISIONS
from dohyo.evaluation.scores.driving import kept_to_the_lanes, route_completion


def success(ego: EgoRecord) -> bool:
    """Whether the goal was reached without any collision and mostly in the lanes; red lights do not fail it.

    Source: Codevilla et al. 2019, NoCrash, where walls stand beside the roads; see `kept_to_the_lanes`.
    """
    return ego.status.completed and first_collision(ego) is None and kept_to_the_lanes(ego)


def road_completed(ego: EgoRecord) -> float:
    """Percent in [0, 100] of the route completed before the first collision.

    100 * progress at the first collision / route length; route completion where there was none. Some theses call this
    number NoCrash and compare it with success rates of others.
    """
    collision = first_collision(ego)
    if collision is None:
        return route_completion(ego)
    share = collision.route_m / ego.route_length_m
    return 100.0 * min(max(share, 0.0), 1.0)


def drove(ego: EgoRecord, metres: float = 2500.0) -> bool:
    """Whether the ego drove a given distance along its route before the first collision, and mostly in the lanes.

    Routes must have at least this length. Source: Albilani 2023, where 2500 m on routes between random points count as
    success; this is the third number that is called NoCrash.
    """
    return road_completed(ego) / 100.0 * ego.route_length_m >= metres and kept_to_the_lanes(ego)


def first_collision(ego: EgoRecord) -> Infraction | None:
    """The earliest collision of the record, or None."""
    collisions = (one for one in ego.infractions if one.kind in COLLISIONS)
    return min(collisions, key=lambda one: one.time_s, default=None)
