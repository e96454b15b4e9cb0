"""How fast the freeway is: single vehicles in times of real time, queues in days per hour; on one core.

    python -m tests.performance.freeway [--out FILE.json]

Measured by the core's own time, which other processes disturb less than the clock's, and by the clock.
"""

from __future__ import annotations

import argparse
import json
import os
import time
from collections.abc import Callable
from pathlib import Path

import libsumo

from dohyo.sumo_networks.freeway import TICK_S, FreewayScenario, FreewaySimulation
from dohyo.sumo_networks.freeway.days import drive_day
from dohyo.sumo_networks.freeway.scenario import DAY_S

MINUTES = 8
DENSE = FreewayScenario(seed=1, start_s=6.6 * 3600, duration_s=MINUTES * 60.0, warm_up_s=600.0, penetration=0.05)
DAY = FreewayScenario(seed=1, start_s=0.0, duration_s=DAY_S, warm_up_s=0.0, probes=0.15)


def timed(work: Callable[[], object]) -> dict[str, float]:
    """Seconds of the core and of the clock."""
    core, wall = time.process_time(), time.perf_counter()
    work()
    return {"core_s": time.process_time() - core, "wall_s": time.perf_counter() - wall}


def main() -> None:
    """Measures and prints."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path)
    arguments = parser.parse_args()
    facts: dict[str, object] = {"load": os.getloadavg()[0], "sumo": libsumo.getVersion()[1]}
    with FreewaySimulation(DENSE) as simulation:
        vehicles, begin = len(simulation.world.names), simulation.world.departed
        half = MINUTES * 30
        read = timed(lambda: [simulation.tick() for _ in range(round(half / TICK_S))])
        flow = (simulation.world.departed - begin) * 3600 / half
        bare = timed(lambda: libsumo.simulationStep(DENSE.start_s + 2 * half))
    for name, one in (("bare", bare), ("with every vehicle read each tick", read)):
        facts[f"micro, {name}"] = one | {"vehicles": vehicles, "times_real_time": half / one["core_s"]}
        print(
            f"micro, {vehicles} vehicles, {name}: {half / one['core_s']:.0f} x real time ({half / one['wall_s']:.0f})"
        )
    day = timed(lambda: drive_day(DAY, "meso"))
    facts["meso day"] = day
    facts["demand_vph"] = flow
    print(f"meso, a day: {day['core_s']:.1f} s on the core, {3600 / day['core_s']:.0f} days per hour")
    if arguments.out:
        arguments.out.write_text(json.dumps(facts, indent=1))


if __name__ == "__main__":
    main()
