"""A day of traffic without an ego: does it keep flowing? `python tests/performance/gridlock.py [HOURS]`.

Prints, per world: mean speed in the first and the last hour, the longest standstill, and how many vehicles SUMO had to
move on after 300 s (`timeToTeleport` in vehicle_types.add.xml). A standstill longer than the 180 s after which an ego
counts as blocked is what the criterion's gridlock is for.
"""

from __future__ import annotations

import sys
from multiprocessing import get_context

import libsumo
import numpy as np

from dohyo.evaluation.benchmarks.benchmark import load_benchmark
from dohyo.sumo_networks.networks.catalog import load_network
from dohyo.sumo_networks.scenario import Scenario, Traffic
from dohyo.sumo_networks.simulation import Simulation, plan_scenario

WORLDS = {
    "town-test dense": ("nocrash", "town-test", Traffic(vehicles=70, pedestrians=150)),
    "town-train dense": ("nocrash", "town-train", Traffic(vehicles=100, pedestrians=250)),
    "ingolstadt": ("quickstart", "ingolstadt", Traffic(vehicles=50, bicycles=10, pedestrians=20)),
}
TICKS_PER_HOUR = 36_000


def flow(name: str, hours: float, seed: int = 0) -> str:
    """One line about one world."""
    benchmark, network, traffic = WORLDS[name]
    mission = next(iter(next(m for c, m in load_benchmark(benchmark).missions.items() if c in (network, "all"))))
    scenario = Scenario(network=network, missions=(mission,), traffic=traffic, seed=seed)
    simulation = Simulation(plan_scenario(load_network(network), scenario))
    simulation.retire(0)
    nothing, speeds, longest, moved_on = np.zeros((1, 2)), [], 0.0, 0
    for tick in range(round(hours * TICKS_PER_HOUR)):
        simulation.tick(nothing)
        moved_on += libsumo.simulation.getStartingTeleportNumber()
        if tick % 100 == 0:
            vehicles = libsumo.vehicle.getIDList()
            speeds.append(np.mean([libsumo.vehicle.getSpeed(one) for one in vehicles]))
            longest = max(longest, *(libsumo.vehicle.getWaitingTime(one) for one in vehicles))
    simulation.close()
    part = max(round(360 * min(hours, 1.0)), 1)
    return (
        f"{name:18} {hours:4.1f} h  mean speed {np.mean(speeds[:part]):.2f} then {np.mean(speeds[-part:]):.2f} m/s  "
        f"longest standstill {longest:4.0f} s  moved on {moved_on}"
    )


def main() -> None:
    hours = float(sys.argv[1]) if len(sys.argv) > 1 else 24.0
    with get_context("spawn").Pool(1, maxtasksperchild=1) as pool:
        for name in WORLDS:
            print(pool.apply(flow, (name, hours)), flush=True)


if __name__ == "__main__":
    main()
