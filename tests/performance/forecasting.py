"""How long a forecast takes, batch 1, on one core: mean of 50,000 after 1,000 to warm up.

    python -m tests.performance.forecasting [--quick] [--out FILE.json]

Goals are for the core's own time, which other processes disturb less than the clock's.
"""

from __future__ import annotations

import argparse
import json
import os
from dataclasses import asdict
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")

from dohyo.agents.forecasting.study.latency import RUNS, WARM_UPS, of_network

SEGMENTS = 21
GOALS_MS = {("sa-lstm", 1): (0.5, 0.15), ("sa-lstm-n-step", 3): (0.9, 0.3)}
OTHERS = (("lstm", 1), ("convlstm", 1), ("sa-convlstm", 1), ("transformer", 1), ("tsmixer", 3), ("sa-lstm", 3))


def main() -> None:
    """Measures, prints, and compares with the goals."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="500 runs after 100, also of the other networks")
    parser.add_argument("--out", type=Path)
    arguments = parser.parse_args()
    runs, warm_ups = (500, 100) if arguments.quick else (RUNS, WARM_UPS)
    results = {}
    for name, rows in (*GOALS_MS, *(OTHERS if arguments.quick else ())):
        measured = of_network(name, SEGMENTS, rows, runs, warm_ups)
        goals = dict(zip(("torch", "onnx"), GOALS_MS.get((name, rows), (None, None)), strict=True))
        for where, one in measured.items():
            goal = goals[where]
            results[f"{name}, {rows} rows, {where}"] = asdict(one)
            print(
                f"{name:<15} {rows} row{'s' if rows > 1 else ' '} {where:<6}{one.core_ms:8.3f} ms on the core, "
                f"{one.wall_ms:.3f} by the clock" + (f" (goal {goal})" if goal else ""),
                flush=True,
            )
    if arguments.out:
        facts = {"runs": runs, "warm_ups": warm_ups, "load": os.getloadavg()[0], "ms": results}
        arguments.out.write_text(json.dumps(facts, indent=1))


if __name__ == "__main__":
    main()
