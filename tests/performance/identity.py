"""Whether driving is as it was: digests of trajectories of every agent on every benchmark, for two commits.

    python -m tests.performance.identity --write before.json      # in a checkout of one commit
    python -m tests.performance.identity --compare before.json    # in a checkout of the other

Each agent drives the first seconds of some scenarios of each benchmark. A digest is that of all actors' motion. The
exit code is 1 where a drive differs.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import numpy as np

from dohyo.agents.registry import resolve
from dohyo.evaluation.agent import make_agent
from dohyo.evaluation.benchmarks.benchmark import load_benchmark
from dohyo.evaluation.episode.runner import drive_episode
from dohyo.evaluation.records.trajectory import Trajectory
from dohyo.sumo_networks.scenario import Scenario

BENCHMARKS: Final = (
    *("quickstart", "corl2017", "endurance", "fleet", "leaderboard", "leaderboard-train", "nocrash"),
    *("obstacles", "precrash", "val14", "val14-reactive"),
)
AGENTS: Final = (
    *("autopilot", "reckless", "random", "idm", "pdm-closed", "mbappe", "random-shooting", "predictor-only"),
    *("rules", "ghrl"),
)
COLUMNS: Final = ("tick", "key", "kind", "x", "y", "heading", "speed", "length", "width")
SCENARIOS, SECONDS = 2, 8.0


def digest(trajectory: Trajectory) -> str:
    """Digest of all motion, and of the states of lights."""
    columns = [np.ascontiguousarray(getattr(trajectory, name)).tobytes() for name in COLUMNS]
    return hashlib.sha256(b"".join([*columns, np.ascontiguousarray(trajectory.signals).tobytes()])).hexdigest()


def scenarios(benchmark: str) -> Iterator[tuple[str, Scenario]]:
    """Scenarios spread over a benchmark, cut to the first seconds."""
    every = load_benchmark(benchmark).scenarios([0])
    for number in np.linspace(0, len(every) - 1, SCENARIOS).round().astype(int):
        cut = every[number].model_copy(update={"time_limit_s": SECONDS})
        yield f"{benchmark} {number}", cut


def drives() -> Iterator[tuple[str, str]]:
    """Name and digest of every drive."""
    for benchmark in BENCHMARKS:
        for name, scenario in scenarios(benchmark):
            for agent in AGENTS:
                agents = {mission.name: make_agent(resolve(agent), {}) for mission in scenario.missions}
                _, trajectory = drive_episode(scenario, agents)
                for one in agents.values():
                    one.close()
                yield f"{name} {agent}", digest(trajectory)


def main() -> int:
    """Writes the digests, or compares them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    choice = parser.add_mutually_exclusive_group(required=True)
    choice.add_argument("--write", type=Path)
    choice.add_argument("--compare", type=Path)
    options = parser.parse_args()
    found = {}
    before = json.loads(options.compare.read_text()) if options.compare else {}
    for name, value in drives():
        found[name] = value
        if options.compare and before.get(name) != value:
            print(f"different: {name}", flush=True)
    if options.write:
        options.write.write_text(json.dumps(found, indent=1) + "\n")
        return 0
    different = sum(before.get(name) != value for name, value in found.items())
    print(f"{len(found)} drives, {different} of them different")
    return int(different > 0)


if __name__ == "__main__":
    sys.exit(main())
