"""End of an episode: at the goal, after the time limit, or after the planned duration.

Environments and evaluations use the same functions, so that training and evaluation episodes end alike.
"""

from __future__ import annotations

from dohyo.sumo_networks.units import TICK_S
from dohyo.sumo_networks.world import World

GOAL_SHARE = 0.99
GOAL_DISTANCE_M = 10.0
_ROUNDING_S = 1e-6


def reached_goal(world: World, ego: int) -> bool:
    """Whether an ego is at its goal: over 99 % of the route driven and less than 10 m left (CARLA Leaderboard)."""
    route, progress = world.routes[ego], float(world.egos.progress[ego])
    aside = abs(float(world.egos.lateral[ego]))
    return progress > GOAL_SHARE * route.length and route.length - progress + aside < GOAL_DISTANCE_M


def is_late(world: World, limit_s: float | None) -> bool:
    """Whether the time limit [s] has passed; False without a limit."""
    return limit_s is not None and exceeds(world.time, limit_s)


def exceeds(time_s: float, limit_s: float) -> bool:
    """Whether a time is above a limit, s: three ticks of 0.1 s, in floating point a bit more, are not above 0.3 s."""
    return time_s > limit_s + _ROUNDING_S


def reaches(time_s: float, limit_s: float) -> bool:
    """Whether a time is at least a limit, s: differences of times in ticks, in floating point a bit less, count."""
    return time_s >= limit_s - _ROUNDING_S


def is_played_out(world: World, duration_s: float | None) -> bool:
    """Whether a scenario's planned duration [s] has passed; False without one."""
    return duration_s is not None and world.time >= duration_s - TICK_S / 2
