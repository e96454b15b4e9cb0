"""nuPlan's closed-loop score of one drive, from its record, its trajectory, the network and the reference's progress.

    score = 100 x NC x DAC x DDC x MP x (5 EP + 5 TTC + 4 SL + 2 C) / 16

Every term is in [0, 1]. nuPlan has no term for red lights: they are counted beside the score. CONTEXT.md lists the
terms, the thresholds and the differences from nuPlan. Source: nuPlan devkit, closed-loop non-reactive agents score;
definitions re-implemented.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numba import njit

from dohyo.evaluation.criteria.fault import BEHIND_RAD
from dohyo.evaluation.records.record import EgoRecord, EpisodeRecord
from dohyo.evaluation.records.specifications import InfractionKind
from dohyo.evaluation.records.trajectory import Trajectory
from dohyo.evaluation.scores.nuplan.frames import Frames, frames_of
from dohyo.sumo_networks.arrays import BoolArray, FloatArray
from dohyo.sumo_networks.ego.dynamics import VehicleParameters
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.geometry import boxes_overlap
from dohyo.sumo_networks.networks.network import RoadNetwork
from dohyo.sumo_networks.portable_math import arctan2
from dohyo.sumo_networks.units import TICK_S
from dohyo.sumo_networks.world import ActorKind

OUTSIDE_M: Final = 0.3
AGAINST_M: Final = (2.0, 6.0)
AGAINST_WITHIN_S: Final = 1.0
LEAST_PROGRESS: Final = 0.2
PROGRESS_THRESHOLD_M: Final = 2.0
TTC_STANDING_MPS: Final = 0.005
TTC_BOUND_S: Final = 0.95
TTC_HORIZON_S: Final = 3.0
AHEAD_RAD: Final = math.radians(30.0)
OVERSPEED_MPS: Final = 2.23
LONGITUDINAL_MPS2: Final = (-4.05, 2.40)
LATERAL_MPS2: Final = 4.89
YAW_RATE: Final = 0.95
YAW_ACCELERATION: Final = 1.93
LONGITUDINAL_JERK: Final = 4.13
JERK: Final = 8.37
ACCELERATION_WINDOW: Final = 7
JERK_WINDOW: Final = 15
_WEIGHTS: Final = {"progress": 5.0, "time_to_collision": 5.0, "speed_limit": 4.0, "comfort": 2.0}


@dataclass(frozen=True, slots=True)
class ClosedLoop:
    """The terms of one drive, each in [0, 1], where 1 is best.

    Attributes:
        no_collision: NC, no at-fault collision.
        drivable_area: DAC, drivable-area compliance.
        driving_direction: DDC, driving-direction compliance.
        making_progress: MP, making progress.
        time_to_collision: TTC within bound.
        speed_limit: SL, speed-limit compliance.
        progress: EP, progress of the ego as a share of the reference's.
        comfort: C, comfort.
        red_lights: Number of red lights crossed, which enters no term.
    """

    no_collision: float
    drivable_area: float
    driving_direction: float
    making_progress: float
    time_to_collision: float
    speed_limit: float
    progress: float
    comfort: float
    red_lights: int = 0

    @property
    def multiplier(self) -> float:
        """NC x DAC x DDC x MP."""
        return self.no_collision * self.drivable_area * self.driving_direction * self.making_progress

    @property
    def score(self) -> float:
        """Percent in [0, 100]."""
        weighted = math.fsum(weight * getattr(self, term) for term, weight in _WEIGHTS.items())
        return 100.0 * self.multiplier * weighted / math.fsum(_WEIGHTS.values())


def closed_loop(
    record: EpisodeRecord, trajectory: Trajectory, network: RoadNetwork, reference_m: float, ego: int = 0
) -> ClosedLoop:
    """Every term of one drive.

    All terms of a drive are 0 if the agent failed as a program: leaving the drive out would reward the failure.

    Args:
        record: Record of the episode.
        trajectory: Trajectory of the same episode.
        network: Network that was driven on.
        reference_m: Progress of the reference in the same scenario, m.
        ego: Index of the ego.

    Raises:
        InvalidInputError: The reference is not a distance, or the trajectory does not contain the drive.
    """
    if not 0.0 <= reference_m < math.inf:
        raise InvalidInputError(f"expected the reference's progress in metres, got {reference_m}")
    facts = record.egos[ego]
    if facts.status.agent_fault:
        return ClosedLoop(0, 0, 0, 0, 0, 0, 0, 0, red_lights(facts))
    frames = frames_of(record, trajectory, network, ego)
    if not len(frames):
        raise InvalidInputError(f"scenario '{record.scenario.name}': the trajectory holds nothing of ego {ego}")
    progress = ego_progress(frames, reference_m)
    return ClosedLoop(
        no_collision=no_collision(frames),
        drivable_area=drivable_area(frames),
        driving_direction=driving_direction(frames),
        making_progress=float(progress >= LEAST_PROGRESS),
        time_to_collision=time_to_collision(frames),
        speed_limit=speed_limit(frames),
        progress=progress,
        comfort=comfort(frames),
        red_lights=red_lights(facts),
    )


def red_lights(ego: EgoRecord) -> int:
    """Number of red lights crossed."""
    return sum(one.kind is InfractionKind.RED_LIGHT for one in ego.infractions)


def no_collision(frames: Frames) -> float:
    """NC: product of max(0, 1 - n / (k + 1)) over people (on foot or bicycle), vehicles and objects.

    n is the number of actors or objects that the ego touched by its own fault, each counted once; k is 1 for objects,
    else 0.
    """
    n = {"vulnerable": 0, "vehicle": 0, "object": 0}
    for touch in frames.touches:
        if touch.at_fault:
            vulnerable = touch.kind in (ActorKind.PEDESTRIAN, ActorKind.BICYCLE)
            n["vulnerable" if vulnerable else "object" if touch.kind == ActorKind.STATIC else "vehicle"] += 1
    allowed = {"vulnerable": 0, "vehicle": 0, "object": 1}
    return math.prod(max(0.0, 1.0 - n[one] / (k + 1)) for one, k in allowed.items())


def drivable_area(frames: Frames) -> float:
    """DAC: 0 if any corner of the ego is ever 0.3 m or more outside the drivable area."""
    return float((frames.outside < OUTSIDE_M).all())


def driving_direction(frames: Frames) -> float:
    """DDC: 1 if the ego went back less than 2 m along its lanes within any 1 s, 0.5 if less than 6 m, else 0.

    Metres forward are subtracted from metres back. A tick with the centre on no lane counts 0 m.
    """
    lane, offset, error = frames.lanes
    moved = np.diff(frames.boxes[:, :2], axis=0, prepend=frames.boxes[:1, :2])
    lane_direction = frames.boxes[:, 2] - error
    forward = moved[:, 0] * np.cos(lane_direction) + moved[:, 1] * np.sin(lane_direction)
    on_lane = (lane >= 0) & (np.abs(offset) <= 0.5 * frames.network.lanes.width[lane])
    within = np.ones(round(AGAINST_WITHIN_S / TICK_S))
    back = -float(np.convolve(np.where(on_lane, forward, 0.0), within)[: len(frames)].min())
    return 1.0 if back < AGAINST_M[0] else 0.5 if back < AGAINST_M[1] else 0.0


def ego_progress(frames: Frames, reference_m: float) -> float:
    """EP: progress of the ego along its route as a share of the reference's, both taken as at least 2 m; at most 1.

    EP is 0 for an ego that ends more than 2 m behind its start.
    """
    progress = float(frames.progress[-1] - frames.progress[0])
    if progress < -PROGRESS_THRESHOLD_M:
        return 0.0
    return min(1.0, max(progress, PROGRESS_THRESHOLD_M) / max(reference_m, PROGRESS_THRESHOLD_M))


def speed_limit(frames: Frames) -> float:
    """SL: 1 - overspeed, integrated over time, / (2.23 m/s x duration); not below 0."""
    if len(frames) < 2:
        return 1.0
    lane = frames.lanes[0]
    limit = np.where(lane >= 0, frames.network.lanes.speed[lane], np.inf)
    over = np.maximum(0.0, frames.speed - limit)[1:]
    return max(0.0, 1.0 - float(over.sum()) / (OVERSPEED_MPS * len(over)))


def time_to_collision(frames: Frames) -> float:
    """TTC: 1 if the time to collision is never below 0.95 s, else 0; see `times_to_collision`."""
    return float((times_to_collision(frames) > TTC_BOUND_S).all())


def times_to_collision(frames: Frames) -> FloatArray:
    """(T,) time to collision [s] if all actors keep speed and heading; infinity beyond 3 s.

    Actors within 30 degrees of the heading count, seen from the rear axle. While the ego is in several lanes, off the
    drivable area or in a junction, all actors that are not behind it count. The time is infinite while the ego stands
    (at most 0.005 m/s) and 0 at an at-fault collision. An actor that has touched the ego no longer counts.
    """
    touched = {touch.key: touch.tick for touch in frames.touches}
    wide = ~frames.keeps_lane | (frames.outside > 0.0) | frames.in_junction
    times = np.full(len(frames), np.inf)
    for tick, others in enumerate(frames.others):
        if frames.speed[tick] > TTC_STANDING_MPS and len(others.key):
            gone = np.array([touched.get(int(key), len(frames)) <= tick for key in others.key], dtype=np.bool_)
            boxes = others.boxes()
            rows = np.flatnonzero(_ahead(frames.boxes[tick], boxes, bool(wide[tick])) & ~gone)
            if len(rows):
                times[tick] = _first_meeting(
                    frames.boxes[tick], float(frames.speed[tick]), boxes[rows], others.speed[rows]
                )
    for touch in frames.touches:
        if touch.at_fault:
            times[touch.tick] = 0.0
    return times


def _ahead(ego: FloatArray, boxes: FloatArray, wide: bool) -> BoolArray:
    """(M,) whether each box's centre is ahead of the ego or, if `wide`, not behind it, seen from its rear axle."""
    back = VehicleParameters().axle_to_centre
    x, y = ego[0] - back * math.cos(ego[2]), ego[1] - back * math.sin(ego[2])
    bearing = arctan2(boxes[:, 1] - y, boxes[:, 0] - x) - ego[2]
    return np.asarray(np.cos(bearing) >= math.cos(BEHIND_RAD if wide else AHEAD_RAD))


@njit(cache=True)
def _first_meeting(ego: FloatArray, speed: float, boxes: FloatArray, speeds: FloatArray) -> float:
    """Time [s] at which the ego's box first overlaps one of (M, 5) boxes, in steps of 0.1 s; infinity beyond 3 s."""
    own, others = ego.copy().reshape(1, 5), boxes.copy()
    for step in range(1, round(TTC_HORIZON_S / TICK_S) + 1):
        own[0, 0] += speed * math.cos(ego[2]) * TICK_S
        own[0, 1] += speed * math.sin(ego[2]) * TICK_S
        others[:, 0] += speeds * np.cos(boxes[:, 2]) * TICK_S
        others[:, 1] += speeds * np.sin(boxes[:, 2]) * TICK_S
        if boxes_overlap(own, others).any():
            return step * TICK_S
    return math.inf


def comfort(frames: Frames) -> float:
    """C: 1 if accelerations, jerks, yaw rate and yaw acceleration all stay within nuPlan's bounds, else 0."""
    return float(all(low <= value <= high for value, low, high in _extremes(frames)))


def _extremes(frames: Frames) -> list[tuple[float, float, float]]:
    """Smallest and largest value of each quantity, each with its bounds."""
    heading = np.unwrap(frames.boxes[:, 2])
    longitudinal = _derivative(frames.speed, ACCELERATION_WINDOW)
    lateral = frames.speed * _derivative(heading, ACCELERATION_WINDOW)
    bounds = (
        (longitudinal, *LONGITUDINAL_MPS2),
        (lateral, -LATERAL_MPS2, LATERAL_MPS2),
        (_derivative(heading, JERK_WINDOW), -YAW_RATE, YAW_RATE),
        (_derivative(heading, JERK_WINDOW, order=2), -YAW_ACCELERATION, YAW_ACCELERATION),
        (_derivative(longitudinal, JERK_WINDOW), -LONGITUDINAL_JERK, LONGITUDINAL_JERK),
        (_derivative(np.hypot(longitudinal, lateral), JERK_WINDOW), -JERK, JERK),
    )
    return [(float(end), low, high) for values, low, high in bounds for end in (values.min(), values.max())]


def _derivative(values: FloatArray, window: int, order: int = 1) -> FloatArray:
    """(T,) derivative by time from a Savitzky-Golay filter, whose polynomial is one degree higher; 0 in a short drive.

    Windows are odd: an even window would lag by half a tick.
    """
    from scipy.signal import savgol_filter  # type: ignore[import-untyped]  # slow to import: only if needed

    count = len(values)
    window = min(window, count if count % 2 else count - 1)
    if window <= order + 1:
        return np.zeros(count)
    return np.asarray(savgol_filter(values, window, order + 1, deriv=order, delta=TICK_S))
