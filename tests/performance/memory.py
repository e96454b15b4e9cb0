"""What a thousand episodes leave behind in one process: `python tests/performance/memory.py [episodes]`.

Resident memory is read after a warm-up, in which caches fill and the allocator finds its size, and at the end. Exits
with 1 where the growth reaches the limit.
"""

from __future__ import annotations

import gc
import sys
import time
from pathlib import Path

from dohyo.agents.experts.reckless import Reckless
from dohyo.evaluation.episode.runner import run_episode
from dohyo.sumo_networks.scenario import Mission, Place, Scenario, Traffic

EPISODES, WARM_UP, LIMIT_MB = 1000, 50, 50.0


def scenario(episode: int) -> Scenario:
    """A drive of five seconds along a street of Ingolstadt, among others; another seed each time."""
    mission = Mission(
        start=Place(lane="737320747#3_2", position_m=5.0), goal=Place(lane="726514449_2", position_m=-15.0)
    )
    traffic = Traffic(vehicles=20, bicycles=3, pedestrians=20, warm_up_s=3.0)
    return Scenario(network="ingolstadt", missions=(mission,), traffic=traffic, time_limit_s=5.0, seed=episode)


def resident_mb() -> float:
    """Resident memory of this process, in units of 10^6 bytes."""
    gc.collect()
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * 4096 / 1e6


def main() -> int:
    """Drives, measures, and says how it went."""
    episodes = int(sys.argv[1]) if len(sys.argv) > 1 else EPISODES
    agent = Reckless()
    before, began = 0.0, time.perf_counter()
    for episode in range(WARM_UP + episodes):
        if episode == WARM_UP:
            before = resident_mb()
        run_episode(scenario(episode), {"ego": agent})
        if episode >= WARM_UP and (episode - WARM_UP + 1) % max(episodes // 5, 1) == 0:
            print(f"{episode - WARM_UP + 1:>6} episodes: {resident_mb():.1f} MB", flush=True)
    growth = resident_mb() - before
    seconds = time.perf_counter() - began
    print(
        f"{before:.1f} MB before, {growth:+.1f} MB after {episodes} episodes ({seconds:.0f} s); limit {LIMIT_MB:.0f} MB"
    )
    return int(growth >= LIMIT_MB)


if __name__ == "__main__":
    sys.exit(main())
