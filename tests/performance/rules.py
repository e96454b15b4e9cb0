"""How long rules and RSS take: one critical moment grounded and solved, 30 actors judged, a whole decision.

Critical moments are those of hand-made traffic: a leader too near, cars and people crossing, a light, a blocked lane.
Each is solved many times; the median over moments of each one's median, and of each one's fastest, are printed, in
wall-clock time and in time on the processor. `python tests/performance/rules.py [FILE.json]`
"""

from __future__ import annotations

import json
import os
import platform
import sys
import time
from collections.abc import Callable
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("NUMBA_NUM_THREADS", "1")

import numpy as np

from dohyo.agents.hierarchical.ghrl import Ghrl
from dohyo.agents.planning.warm_up import empty_road
from dohyo.agents.rules.facts import SENSORS
from dohyo.agents.rules.rulebook import read_rulebook
from dohyo.agents.rules.rules_only import RULES, RulesOnly
from dohyo.agents.rules.solver import Fact, Solver, fact
from dohyo.agents.safety.rss import EGO, judge
from dohyo.evaluation.agent import Agent, Mission, Observation
from dohyo.sumo_networks.scenario import Place

REPEATS = 30
MOMENTS = 40
ACTORS = 30
GOALS = {"solve_ms": 2.0, "rss_us": 50.0, "decision_ms": 10.0, "ghrl_ms": 10.0}


def moment(rng: np.random.Generator) -> list[Fact]:
    """A critical moment: somebody too near ahead, and mostly somebody who crosses, a light, or a blocked lane."""
    n = lambda low, high: int(rng.integers(low, high))  # noqa: E731
    speed = n(20, 130)
    out = [fact("speed", speed), fact("advised", 130), fact("standing", 0), fact("refused", 0), fact("sight", 1790)]
    out += [fact("ahead", 1, "car", n(10, 120), n(0, speed)), fact("critical", 1, n(50, 80))]
    if rng.random() < 0.7:
        out += [fact("junction", 1, n(-50, 400), n(401, 600)), fact("signal", 1, ("red", "yellow", "green")[n(0, 3)])]
    for actor in range(10, 10 + n(0, 4)):
        kind = "pedestrian" if rng.random() < 0.3 else "car"
        out += [fact("meets", actor, kind, n(20, 400)), fact("comes", actor, n(0, 300), n(301, 500), n(5, 130))]
        out += [fact("ego_at", actor, n(5, 40), n(41, 70)), fact("other_at", actor, n(5, 40), n(41, 70))]
        out += [fact("right_of_way", actor, holds=rng.random() < 0.5)]
    if rng.random() < 0.3:
        out += [fact("ahead", 2, "static", 300, 0), fact("extent", 2, 360), fact("takes", 2, 90), fact("stood", 2, 50)]
        out += [fact("lane", "left", "against"), fact("in_lane", "left", 3, 600, 690, -100)]
    return out


def observation(rng: np.random.Generator) -> Observation:
    """An ego at 9 m/s among 30 actors in its lane and those beside."""
    out = empty_road((*SENSORS, "ego_state"))
    out["speedometer"][0] = 9.0
    out["navigation"][:] = 0.0, 500.0, 100.0
    out["route"][:, 0], out["route"][:, 4:6] = np.arange(len(out["route"])), (13.9, 3.2)
    out["conflicts"][:, :4], out["conflicts"][:, 6] = 1000.0, -1.0
    for row in range(3):
        out["conflicts"][row] = 20.0 + 5 * row, 30.0, 15.0 + 3 * row, 25.0, 8.0, 1.0 - row, 0.0, row
    out["objects"][:] = 0.0
    out["objects"][:, 0] = -1.0
    for i in range(ACTORS):
        x, y = float(rng.uniform(8.0, 90.0)), 3.2 * int(rng.integers(-1, 2))
        out["objects"][i] = 0.0, x, y, 0.0, float(rng.uniform(0.0, 12.0)), 4.5, 1.8, i
    return out


def measured(calls: list[Callable[[], object]], repeats: int = REPEATS) -> dict[str, float]:
    """Seconds: medians over the calls of each one's median and fastest."""
    wall, processor = np.empty((len(calls), repeats)), np.empty((len(calls), repeats))
    for row, call in enumerate(calls):
        call()
        for column in range(repeats):
            start, began = time.perf_counter(), time.process_time()
            call()
            wall[row, column], processor[row, column] = time.perf_counter() - start, time.process_time() - began
    return {
        "median": float(np.median(np.median(wall, axis=1))),
        "fastest": float(np.median(wall.min(axis=1))),
        "processor_median": float(np.median(np.median(processor, axis=1))),
    }


def measure() -> dict[str, dict[str, float]]:
    """Every measurement, in the unit of its name."""
    rng = np.random.default_rng(0)
    solver, constants = Solver(read_rulebook(RULES)), EGO.numbers
    moments = [moment(rng) for _ in range(MOMENTS)]
    rows = [rng.uniform(-1.0, 1.0, (ACTORS, 8)) * (60, 60, 8, 8, 10, 1, 1, 1) for _ in range(10)]
    seen = [observation(rng) for _ in range(10)]
    agents: dict[str, Agent] = {"decision_ms": RulesOnly(), "ghrl_ms": Ghrl()}
    for agent in agents.values():
        agent.warm_up()
        agent.reset(Mission(start=Place(lane=""), goal=Place(lane="")), 0)
    return {
        "solve_ms": _scaled(measured([lambda facts=facts: solver.decide(facts) for facts in moments]), 1e3),
        "rss_us": _scaled(
            measured([lambda a=a: judge(9.0, 0.0, 0.0, 2.25, 0.9, a, constants) for a in rows], 500), 1e6
        ),
        **{
            name: _scaled(measured([lambda o=o, a=agent: a.act(o) for o in seen]), 1e3)
            for name, agent in agents.items()
        },
    }


def main() -> None:
    """Measures, prints, and writes JSON where a file is given."""
    result = measure()
    for name, numbers in result.items():
        print(
            f"{name:12} goal {GOALS[name]:5.1f}  " + "  ".join(f"{key} {value:.2f}" for key, value in numbers.items())
        )
    if len(sys.argv) > 1:
        machine = {"machine": platform.machine(), "cpus": os.cpu_count(), "load": os.getloadavg()[0]}
        Path(sys.argv[1]).write_text(json.dumps({**result, "goals": GOALS, **machine}, indent=2) + "\n")


def _scaled(numbers: dict[str, float], factor: float) -> dict[str, float]:
    return {name: round(value * factor, 3) for name, value in numbers.items()}


if __name__ == "__main__":
    main()
