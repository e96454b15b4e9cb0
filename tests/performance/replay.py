"""How long a replay of 200 s with 100 actors takes to make, and how large it is.

`OMP_NUM_THREADS=1 python tests/performance/replay.py [--json FILE]`
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path

import numpy as np

from dohyo.evaluation.benchmarks.benchmark import load_benchmark
from dohyo.evaluation.records.record import AgentInfo, EgoRecord, EpisodeRecord, Versions
from dohyo.evaluation.records.specifications import Status
from dohyo.evaluation.records.trajectory import Trajectory
from dohyo.service.episodes.replay import encode, replay_of
from dohyo.sumo_networks.networks.catalog import load_network
from dohyo.sumo_networks.networks.network import RoadNetwork
from dohyo.sumo_networks.world import ActorKind

TICKS, ACTORS, TIMES = 2000, 100, 5


def wandering() -> Trajectory:
    """An ego and actors that turn and change speed at random."""
    generator = np.random.default_rng(0)
    shape = TICKS, ACTORS + 1
    speed = np.abs(generator.normal(0, 0.3, shape).cumsum(axis=0)) % 15
    heading = generator.normal(0, 0.01, shape).cumsum(axis=0)
    x, y = (5700 + (0.1 * speed * turn(heading)).cumsum(axis=0) for turn in (np.cos, np.sin))
    keys = np.tile(np.arange(-1, ACTORS, dtype=np.int32), TICKS)
    columns = {"x": x, "y": y, "heading": heading, "speed": speed, "length": 0 * x + 5.0, "width": 0 * x + 1.8}
    columns |= dict.fromkeys(("acceleration", "steering", "progress", "lateral"), speed)
    return Trajectory(
        tick=np.repeat(np.arange(TICKS, dtype=np.int32), ACTORS + 1),
        key=keys,
        kind=np.where(keys < 0, ActorKind.EGO, ActorKind.CAR).astype(np.uint8),
        **{name: values.ravel().astype(np.float32) for name, values in columns.items()},
        names={key: f"actor{key}" for key in range(-1, ACTORS)},
        signals=np.zeros((0, 3), dtype=np.int32),
    )


def facts(network: RoadNetwork, trajectory: Trajectory) -> EpisodeRecord:
    """Of a drive through the quickstart."""
    agent = AgentInfo(name="made", entry="made:Made", track="map", sensors=(), control="pedals_steering")
    drive = {"duration_s": 0.1 * TICKS, "route_length_m": 300.0, "progress_m": 300.0, "driven_m": 300.0}
    return EpisodeRecord(
        scenario=load_benchmark("quickstart").scenarios([0])[0],
        egos=(EgoRecord(name="ego", agent=agent, status=Status.COMPLETED, **drive),),
        ticks=TICKS,
        versions=Versions(dohyo="0", sumo="0", network_sha256=network.sha256),
        trajectory_sha256=trajectory.sha256(),
    )


def measure() -> dict[str, float]:
    """The best of a few: milliseconds of wall clock and of CPU, megabytes compressed."""
    network, trajectory = load_network("ingolstadt"), wandering()
    record = facts(network, trajectory)
    times, content = [], b""
    for _ in range(TIMES):
        began = time.perf_counter(), time.process_time()
        content = encode(replay_of(record, trajectory, network, episode="ep", rules="2.0"))
        times.append((1000 * (time.perf_counter() - began[0]), 1000 * (time.process_time() - began[1])))
    wall, cpu = (min(column) for column in zip(*times, strict=True))
    return {"wall_ms": wall, "cpu_ms": cpu, "gzip_mb": len(content) / 1e6}


def main() -> None:
    """Prints the numbers, and writes them where asked."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    numbers = measure()
    for name, value in numbers.items():
        print(f"{name:10} {value:8.2f}")
    if options.json:
        options.json.write_text(json.dumps(numbers, indent=1))


if __name__ == "__main__":
    main()
