"""Detour: the way of a planner beside the middle of its lane, judged by the rules of the autopilot.

The rules say which obstacle is one, when the lane beside or the oncoming one is free for long enough, and where to wait
(`blockers`, `passing`, `gaps`); and when to make room for an emergency vehicle, or for oncoming traffic in the ego's
lane (`courtesy`). The planner then plans along its route shifted by the sidestep, in its own simulation and with its
own score.
"""

from __future__ import annotations

import math

import numpy as np

from dohyo.agents.experts import gaps
from dohyo.agents.experts.courtesy import KEEP_RIGHT_RAMP_M, YIELDING_M_S, EmergencyYielding, keep_right
from dohyo.agents.experts.passing import FREE, PASSING_M_S, Passing
from dohyo.agents.planning import surroundings
from dohyo.agents.planning.scene import Scene
from dohyo.agents.planning.sidestep import Sidestep
from dohyo.agents.planning.situation import CELL_M, GRID_X_M, GRID_Y_M, ROAD_BIT, ROUTE_BIT, Situation
from dohyo.agents.planning.surroundings import Surroundings
from dohyo.evaluation.agent import Observation
from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.portable_math import arctan2
from dohyo.sumo_networks.sensors.path import BEHIND

LIMIT_M = 30
MIDDLE_M = 0.3
JUNCTION_M = 5.0
"""Nearer to a junction, vehicles that turn look like oncoming traffic in this lane."""
RIGHT_STEP_M = 0.05
STRIP_M = 1.2
"""Half the width of the strip beside the route that counts as the route's while the ego passes, m."""
AWAY_M = 1e4
_SAMPLE_M = 0.75 * CELL_M


class Detour:
    """Follows one drive; every tick `update`, then `cleared` and `applied`.

    Attributes:
        passing: Whether the ego is passing an obstacle, the way back to its lane not included.
        returning: Whether it is on the way back, until it is in the middle of its lane.
    """

    def __init__(self, length: float, width: float) -> None:
        self._half_length, self._half_width = 0.5 * length, 0.5 * width
        self.reset()

    def reset(self) -> None:
        """Clears the state of the last episode."""
        self._passing = Passing(self._half_length, self._half_width)
        self._yielding = EmergencyYielding(self._half_length)
        self._aside, self._right, self._stops_at = Sidestep(), 0.0, FREE
        self._progress = 0.0
        self._pose: FloatArray | None = None
        self._passed: frozenset[int] = frozenset()
        self.returning = False

    @staticmethod
    def warm_up() -> None:
        """Compiles the kernels that an empty road does not need."""
        surroundings.warm_up()
        surroundings.project(0.0, 0.0, np.zeros((BEHIND + LIMIT_M, 6)))  # in double precision
        gaps.warm_up()

    @property
    def passing(self) -> bool:
        """See the class."""
        return self._passing.active

    def update(self, observation: Observation, scene: Scene) -> None:
        """Judges one tick: what blocks the lane, whether to pass it now, and who has to be waited for."""
        around, speed = Surroundings(observation), scene.ego.speed
        self._progress += self._driven(observation, scene)
        self._step_aside(around, observation, speed)
        away = self._aside.aside(self._progress) or abs(scene.path.lateral) > MIDDLE_M
        back = self._aside.offset == 0.0 and self._aside.aside(self._progress)
        self.returning = not self._passing.active and (self.returning or back) and away
        self._passed = frozenset(self._passing.making_room(around, speed, self._progress))

    def _step_aside(self, around: Surroundings, observation: Observation, speed: float) -> None:
        """Leaves the middle of the lane for blockers, emergency vehicles and oncoming traffic in this lane."""
        junctions = observation["junctions_ahead"]
        limit = float(observation["path"][BEHIND : BEHIND + LIMIT_M, 4].min())
        if not self._yielding.active:
            self._passing.update(around, junctions, speed, limit, self._progress, self._aside)
        self._yielding.update(around, junctions, speed, self._progress, self._aside, self._passing)
        self._stops_at = FREE
        if self._passing.active or self._yielding.active:
            self._right = 0.0
            if not self._passing.active and self._aside.offset != 0.0 and 0.0 < junctions[0, 0] < 1000.0:
                self._stops_at = float(junctions[0, 0])  # no junction is entered from the wrong lane
            return
        wanted = keep_right(around, self._half_width, speed)
        if junctions[0, 0] < JUNCTION_M:
            wanted = min(wanted, self._right)
        if wanted > self._right + RIGHT_STEP_M or (wanted == 0.0 and self._right > 0.0):
            self._right = wanted
            self._aside.lead(-wanted, self._progress, KEEP_RIGHT_RAMP_M)

    def _driven(self, observation: Observation, scene: Scene) -> float:
        """Metres along the route since the last tick."""
        before, self._pose = self._pose, scene.pose
        if before is None:
            return 0.0
        cos, sin = math.cos(scene.pose[2]), math.sin(scene.pose[2])
        dx, dy = before[0] - scene.pose[0], before[1] - scene.pose[1]
        path = observation["path"].astype(np.float64)
        _, then, _ = surroundings.project(dx * cos + dy * sin, dy * cos - dx * sin, path)
        _, now, _ = surroundings.project(0.0, 0.0, path)
        return now - then

    def cleared(self, scene: Scene, forecast: FloatArray) -> FloatArray:
        """Forecast without the oncoming vehicles that, as judged, leave room or make it.

        Args:
            scene: Of the forecast.
            forecast: (N, 81, 3) x, y [m], heading [rad] of its actors.

        Returns:
            A copy with their poses far away; the same array where there are none.
        """
        gone = np.isin(scene.actors.key, list(self._passed))
        if not gone.any():
            return forecast
        out = forecast.copy()
        out[gone, :, :2] += AWAY_M
        return out

    def applied(self, road: Situation, line_gap: float) -> Situation:
        """Situation along the sidestep: its path, and the places of the actors relative to it.

        Where the ego waits to pass, or to return to its lane before a junction, there is a closed line.

        Args:
            road: Along the route.
            line_gap: Distance of the front to a closed line at a stop, m.
        """
        waits_at = min(self._passing.waits_at, self._stops_at)
        if waits_at < FREE:
            road = road._replace(line=min(road.line, self._half_length + max(waits_at, 0.0) + line_gap))
        if not self._aside.aside(self._progress):
            return road
        s = road.first_s + road.spacing * np.arange(len(road.path))
        offset = np.array([self._aside.at(self._progress + ahead) for ahead in s])
        along = road.along.copy()
        along[:, :, 1] -= np.interp(along[:, :, 0], s, offset)
        most = YIELDING_M_S if self._yielding.active else PASSING_M_S
        top = np.where(np.abs(offset) > self._half_width, most, np.inf)
        path = _shifted(road.path, offset, road.spacing)
        return road._replace(
            path=path,
            along=along,
            limit=np.minimum(road.limit, top),
            allowed=np.minimum(road.allowed, top),
            grid=_with_route(road.grid, path[offset != 0.0], road.spacing),
        )


def _shifted(path: FloatArray, offset: FloatArray, spacing: float) -> FloatArray:
    """(R, 4) path with its points moved to the left [m], and its directions turned."""
    out = path.copy()
    out[:, 0] -= offset * path[:, 3]
    out[:, 1] += offset * path[:, 2]
    heading = arctan2(path[:, 3], path[:, 2])
    heading[:-1] += arctan2(np.diff(offset), spacing)
    out[:, 2], out[:, 3] = np.cos(heading), np.sin(heading)
    return out


def _with_route(grid: np.ndarray, path: FloatArray, spacing: float) -> np.ndarray:
    """Grid on which the roads' cells in a strip along a path belong to the route."""
    ahead = np.arange(0.0, spacing, _SAMPLE_M)
    across = np.arange(-STRIP_M, STRIP_M + 1e-6, _SAMPLE_M)
    x = path[:, 0, None, None] + ahead[:, None] * path[:, 2, None, None] - across * path[:, 3, None, None]
    y = path[:, 1, None, None] + ahead[:, None] * path[:, 3, None, None] + across * path[:, 2, None, None]
    c, r = np.floor((x - GRID_X_M[0]) / CELL_M).astype(int), np.floor((y - GRID_Y_M[0]) / CELL_M).astype(int)
    there = (c >= 0) & (r >= 0) & (c < grid.shape[0]) & (r < grid.shape[1])
    out, c, r = grid.copy(), c[there], r[there]
    out[c, r] |= np.where(out[c, r] & ROAD_BIT, ROUTE_BIT, 0).astype(out.dtype)
    return out
