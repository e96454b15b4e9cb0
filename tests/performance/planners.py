"""How long a decision takes: MBAPPE and PDM-Closed on one core, against simulations and actors.

Each decision is the whole of `act` on an observation with that many moving actors around, of which the sensor shows the
nearest 48: scene, forecast, search. MBAPPE is as it is by default, with its learned predictor; beside it at constant
velocity, and with the value network. Observations differ from decision to decision.

    python tests/performance/planners.py [FILE.json]
    python -m dohyo.agents.mcts.study.speed                          # draws agents/mcts/results/speed.json
"""

from __future__ import annotations

import json
import os
import platform
import sys
import time
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("NUMBA_NUM_THREADS", "1")

import numpy as np

from dohyo.agents.experts.pdm import PdmClosed
from dohyo.agents.mcts.mbappe import Mbappe
from dohyo.agents.planning.scene import SENSORS
from dohyo.agents.planning.warm_up import empty_road
from dohyo.evaluation.agent import Agent, Mission, Observation
from dohyo.sumo_networks.scenario import Place
from dohyo.sumo_networks.sensors.lanes import ATTRIBUTES, POINTS

SIMULATIONS = (64, 128, 256, 512, 1024, 2048, 4096)
ACTORS = (0, 10, 20, 30, 40, 60, 80, 100)
DECISIONS = 100
WAYS: dict[str, dict[str, Any]] = {
    "learned": {},
    "constant velocity": {"predictor": "constant_velocity"},
    "value network": {"value": "network"},
}
"""MBAPPE's settings."""
GOALS_MS = {"mbappe": (10.0, 20.0), "pdm-closed": (15.0, None)}


def traffic(actors: int, rng: np.random.Generator) -> Observation:
    """An ego at 9 m/s in the middle of three lanes among cars that keep theirs, and a few on foot beside the road."""
    out = empty_road(SENSORS)
    out["ego_state"][3] = 9.0
    out["objects"][:] = 0.0
    out["objects"][:, 0] = -1.0
    rows = []
    for i in range(actors):
        lane, x = int(rng.integers(-1, 2)), float(rng.uniform(-60.0, 100.0))
        if abs(x) < 20.0 and lane == 0:
            lane = 1
        kind, y, pace = (6, 7.0, 1.2) if i % 5 == 0 else (0, 3.2 * lane, float(rng.uniform(6.0, 12.0)))
        length, width = (0.3, 0.5) if kind == 6 else (4.5, 1.8)
        rows.append((kind, x, y + float(rng.normal(0.0, 0.2)), 0.0, pace, length, width, i))
    nearest = sorted(rows, key=lambda row: row[1] ** 2 + row[2] ** 2)[: len(out["objects"])]
    for i, row_of in enumerate(nearest):
        out["objects"][i] = row_of
    lanes = out["lanes"]
    row = 0
    for lane in (-1, 0, 1):
        for piece in range(-2, 4):
            lanes[row, :ATTRIBUTES] = lane + 1, piece + 2, 0.0, 3.2, 13.9, 2.0 - abs(lane), -1, -1, -1, -1, -1, -1
            lanes[row, ATTRIBUTES::2] = np.linspace(40.0 * piece, 40.0 * (piece + 1), POINTS)
            lanes[row, ATTRIBUTES + 1 :: 2] = 3.2 * lane
            row += 1
    return out


def milliseconds(agent: Agent, actors: int, decisions: int = DECISIONS) -> dict[str, float]:
    """Wall-clock time per decision, and time on the processor, which other processes disturb less."""
    rng, mission = np.random.default_rng(0), Mission(start=Place(lane=""), goal=Place(lane=""))
    agent.warm_up()
    agent.reset(mission, 0)
    times = []
    for _ in range(decisions + 5):
        seen = traffic(actors, rng)
        began, worked = time.perf_counter(), time.thread_time()
        agent.act(seen)
        times.append((time.perf_counter() - began, time.thread_time() - worked))
    (p50, cpu50), (p99, cpu99) = np.percentile(np.array(times[5:]) * 1000.0, [50, 99], axis=0).round(3).tolist()
    return {"median_ms": p50, "p99_ms": p99, "cpu_median_ms": cpu50, "cpu_p99_ms": cpu99}


def _words(got: dict[str, float]) -> str:
    processor = f"on the processor {got['cpu_median_ms']} and {got['cpu_p99_ms']} ms"
    return f"median {got['median_ms']} ms, p99 {got['p99_ms']} ms; {processor}"


def main(out: Path) -> None:
    """Measures everything."""
    results = {
        "machine": platform.processor() or platform.machine(),
        "load": os.getloadavg()[0],
        "mbappe": milliseconds(Mbappe(), 30, 300),
        "pdm-closed": milliseconds(PdmClosed(), 30, 300),
        "by_simulations": {
            way: {n: milliseconds(Mbappe(**settings, simulations=n), 30) for n in SIMULATIONS}
            for way, settings in WAYS.items()
        },
        "by_actors": {way: {n: milliseconds(Mbappe(**settings), n) for n in ACTORS} for way, settings in WAYS.items()},
    }
    out.write_text(json.dumps(results, indent=1) + "\n")
    for agent, (median, p99) in GOALS_MS.items():
        got = results[agent]
        print(f"{agent}: {_words(got)} (goals {median}, {p99})")
    for key in ("by_simulations", "by_actors"):
        for way, row in results[key].items():
            for n, got in row.items():
                print(f"{way}, {n} {key.removeprefix('by_')}: {_words(got)}")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "planners.json"))
