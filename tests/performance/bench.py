"""How fast the world turns: DrivingEnv against bare libsumo, in one run. `make bench` writes bench.json.

Both simulate the same traffic from the same seed. The bare arm only calls simulationStep; the other drives one ego with
all criteria and vector observations. Blocks of both arms alternate, so that a slow moment of the machine hits both.
"""

from __future__ import annotations

import json
import multiprocessing
import platform
import statistics
import sys
import time
from multiprocessing.connection import Connection
from pathlib import Path

import libsumo
import numpy as np

from evaluation.criteria import criteria_for
from sumo_networks.catalog import load_network
from sumo_networks.env import DrivingEnv
from sumo_networks.scenario import Mission, Place, Scenario, Traffic
from sumo_networks.simulation import Simulation

SENSORS = ("speedometer", "navigation", "lane", "route", "objects", "lights")
CASES = {50: "ingolstadt", 200: "adlershof", 1000: "adlershof"}
MISSIONS = {
    "ingolstadt": ("737320747#3_2", "726514449_2"),
    "adlershof": ("46039050#0_2", "414563781_4"),
}
BLOCK_TICKS, BLOCKS = 40, 8


def scenario(network: str, vehicles: int) -> Scenario:
    """One ego across the network, among so many vehicles."""
    start, goal = MISSIONS[network]
    mission = Mission(start=Place(lane=start, position_m=8.0), goal=Place(lane=goal, position_m=-15.0))
    return Scenario(network=network, missions=(mission,), traffic=Traffic(vehicles=vehicles, warm_up_s=60.0), seed=1)


def bare(pipe: Connection, case: Scenario) -> None:
    """Steps the same traffic, without egos, subscriptions or reads."""
    simulation = Simulation(load_network(case.network), case)
    simulation.start()
    simulation.retire(0)
    _serve(pipe, libsumo.simulationStep)


def driven(pipe: Connection, case: Scenario) -> None:
    """Drives one ego along its route at 5 m/s: control, dynamics, world, criteria, observations."""
    env = DrivingEnv(case, sensors=SENSORS, control="lane_command", reward=None)
    env.reset()
    criteria = criteria_for(case)
    for criterion in criteria:
        criterion.start(env.world, 0)
    action = {"ego": np.array([5.0, 0.0])}

    def tick() -> None:
        before = env.world
        env.step(action)
        for criterion in criteria:
            for _ in criterion.update(before, env.world, 0):
                pass

    _serve(pipe, tick)


def _serve(pipe: Connection, tick: object) -> None:
    """Runs a block whenever asked, and answers with its ticks per second."""
    assert callable(tick)
    for _ in range(BLOCK_TICKS):
        tick()
    pipe.send(0.0)
    while pipe.recv():
        began = time.perf_counter()
        for _ in range(BLOCK_TICKS):
            tick()
        pipe.send(BLOCK_TICKS / (time.perf_counter() - began))


def measure(case: Scenario) -> dict[str, float]:
    """Median ticks per second of both arms, and the median of their ratios block by block."""
    context = multiprocessing.get_context("spawn")
    pipes, processes = [], []
    for arm in (bare, driven):
        ours, theirs = context.Pipe()
        process = context.Process(target=arm, args=(theirs, case))
        process.start()
        pipes.append(ours)
        processes.append(process)
        ours.recv()
    rates: list[list[float]] = [[], []]
    for _ in range(BLOCKS):
        for arm, pipe in enumerate(pipes):
            pipe.send(True)
            rates[arm].append(pipe.recv())
    for pipe, process in zip(pipes, processes, strict=True):
        pipe.send(False)
        process.join()
    return {
        "bare_ticks_per_s": round(statistics.median(rates[0]), 1),
        "env_ticks_per_s": round(statistics.median(rates[1]), 1),
        "ratio": round(statistics.median(b / a for a, b in zip(*rates, strict=True)), 3),
    }


def main() -> None:
    """Prints the table and writes bench.json."""
    results = {}
    print(f"{'network':<12}{'vehicles':>9}{'bare ticks/s':>14}{'env ticks/s':>13}{'ratio':>8}")
    for vehicles, network in CASES.items():
        row = measure(scenario(network, vehicles))
        results[f"{network}-{vehicles}"] = row
        print(f"{network:<12}{vehicles:>9}{row['bare_ticks_per_s']:>14}{row['env_ticks_per_s']:>13}{row['ratio']:>8}")
    document = {"python": sys.version.split()[0], "machine": platform.machine(), "one_ego": results}
    Path("bench.json").write_text(json.dumps(document, indent=1) + "\n")


if __name__ == "__main__":
    main()
