"""Calibration of the freeway for the planner.

    python -m dohyo.agents.speed_planning.study.calibration --seeds 100 101

Mornings without control give the fundamental diagram of the lanes before the bottleneck, and the flow through the
bottleneck at each speed before it. Without a capacity drop, no control can raise throughput.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from dohyo.agents.speed_planning.fundamental_diagram import Triangle, calibrated
from dohyo.evaluation.scores.traffic import PassageCount
from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.freeway.measure import MINUTE_S
from dohyo.sumo_networks.freeway.road import FreewayRoad
from dohyo.sumo_networks.freeway.scenario import FreewayScenario
from dohyo.sumo_networks.freeway.simulation import FreewaySimulation
from dohyo.sumo_networks.freeway.world import FreewayWorld

CELL_M = 200.0
FROM_M = 1000.0
"""Begin of the diagram's cells, m: vehicles have reached their speed there."""
LAST_M = 900.0
"""Stretch before the bottleneck whose speed is compared with the flow through it, m."""
CLASSES_MPS = (0.0, 6.0, 10.0, 14.0, 18.0, 22.0, 26.0, 40.0)
FOLLOWING_MINUTES = 3


@dataclass(frozen=True, eq=False)
class MorningGrid:
    """One morning by minutes (T) and cells of `CELL_M` from `FROM_M` to the bottleneck (X).

    Attributes:
        density: (T, X) veh/m on one lane.
        speed_mps: (T, X) mean, NaN in an empty cell.
        last_mps: (T,) mean speed of the last `LAST_M` before the bottleneck.
        passed: (T,) vehicles that passed into the bottleneck.
    """

    density: FloatArray
    speed_mps: FloatArray
    last_mps: FloatArray
    passed: FloatArray


class Surveyor:
    """Counts vehicles and sums speeds, one look per second."""

    def __init__(self, road: FreewayRoad, start_s: float, minutes: int) -> None:
        self._road, self._start_s = road, start_s
        cells = int((road.bottleneck_m - FROM_M) / CELL_M)
        self._edges = FROM_M + CELL_M * np.arange(cells + 1)
        self._count, self._sum = np.zeros((2, minutes, cells))
        self._last = np.zeros((2, minutes))
        self._passed = np.zeros(minutes)
        self._passage = PassageCount()
        self._lanes = min(road.lanes[: road.mainline.bottleneck])

    def observe(self, world: FreewayWorld) -> None:
        """Adds one world; called once per second."""
        minute = int((world.time_s - self._start_s) // MINUTE_S)
        if not 0 <= minute < len(self._passed):
            return
        main = (world.lane >= 0) & (world.lane < self._lanes)
        where, speed = world.position_m[main], world.speed_mps[main]
        self._count[minute] += np.histogram(where, self._edges)[0]
        self._sum[minute] += np.histogram(where, self._edges, weights=speed)[0]
        last = (where < self._road.bottleneck_m) & (where >= self._road.bottleneck_m - LAST_M)
        self._last[:, minute] += np.count_nonzero(last), speed[last].sum()
        self._passed[minute] += self._passage.observe(world)

    def survey(self) -> MorningGrid:
        """Survey of all worlds so far."""
        speed = np.divide(self._sum, self._count, out=np.full_like(self._sum, np.nan), where=self._count > 0)
        density = self._count / (MINUTE_S * CELL_M * self._lanes)
        return MorningGrid(density, speed, self._last[1] / np.maximum(self._last[0], 1), self._passed)


def surveyed(seed: int, start_s: float, minutes: int) -> MorningGrid:
    """Drives one morning without control.

    Raises:
        SimulationError: SUMO failed.
    """
    scenario = FreewayScenario(seed=seed, start_s=start_s, duration_s=minutes * MINUTE_S)
    with FreewaySimulation(scenario, fuel=False) as simulation:
        surveyor = Surveyor(simulation.road, start_s, minutes)
        while simulation.world.time_s < start_s + minutes * MINUTE_S:
            surveyor.observe(simulation.world)
            simulation.tick()
            simulation.tick()
    return surveyor.survey()


def diagram(surveys: Sequence[MorningGrid]) -> Triangle:
    """Triangle fitted to all mornings' cells; see `fundamental_diagram.calibrated`.

    Raises:
        InvalidInputError: There is no congestion.
    """
    density = np.concatenate([one.density.ravel() for one in surveys])
    return calibrated(density, np.concatenate([one.speed_mps.ravel() for one in surveys]))


def discharge(surveys: Sequence[MorningGrid], demanded: int = 0) -> FloatArray:
    """Flow through the bottleneck in the next three minutes, by the present speed before it.

    Args:
        surveys: Mornings.
        demanded: Minutes at their beginning that are left out, with a demand below the capacity.

    Returns:
        (K, 3) for each pair of neighbours in `CLASSES_MPS` minutes seen, mean veh/h (NaN without any) and its standard
        deviation.
    """
    window = np.ones(FOLLOWING_MINUTES) / FOLLOWING_MINUTES
    flow = np.concatenate([60 * np.convolve(one.passed, window, "valid")[demanded:] for one in surveys])
    speed = np.concatenate([one.last_mps[demanded : len(one.passed) - FOLLOWING_MINUTES + 1] for one in surveys])
    rows = []
    for low, high in pairwise(CLASSES_MPS):
        found = flow[(speed >= low) & (speed < high)]
        rows.append((len(found), found.mean(), found.std()) if len(found) else (0, np.nan, np.nan))
    return np.array(rows, dtype=np.float64)


def main() -> None:
    """Command-line entry point."""
    parser = argparse.ArgumentParser(
        prog="python -m dohyo.agents.speed_planning.study.calibration", description=__doc__
    )
    parser.add_argument("--seeds", type=int, nargs="+", default=[100, 101])
    parser.add_argument("--start", type=float, default=21000.0, help="time of day, s")
    parser.add_argument("--minutes", type=int, default=110)
    parser.add_argument("--demanded", type=int, default=45, help="minute from which demand is near the capacity")
    given = parser.parse_args()
    surveys = [surveyed(seed, given.start, given.minutes) for seed in given.seeds]
    fitted = diagram(surveys)
    print(
        f"free speed {fitted.free_speed_mps:.1f} m/s, waves {fitted.wave_speed_mps:.2f} m/s, jam density "
        f"{1000 * fitted.jam_density:.1f} veh/km, flow out of congestion {3600 * fitted.capacity:.0f} veh/h and lane"
    )
    most = max(np.convolve(one.passed, np.ones(10) * 6, "valid").max() for one in surveys)
    print(f"most that passed the bottleneck in ten minutes: {most:.0f} veh/h")
    rows = discharge(surveys, given.demanded)
    for (low, high), (minutes, mean, spread) in zip(pairwise(CLASSES_MPS), rows, strict=True):
        print(f"{low:g} to {high:g} m/s before it: {mean:.0f} veh/h, deviation {spread:.0f}, {minutes:.0f} minutes")


if __name__ == "__main__":
    main()
