"""Measures how fast dohyo is: `python -m tests.performance [PART ...]`. Prints one table and writes bench.json.

Speed is a ratio taken in the same run: to bare libsumo, to another environment, or to a calibration kernel. A missed
goal is shown and is no failure, since the machine may be slow; the exit code is 1 only where a part is broken.
"""

from __future__ import annotations

import json
import multiprocessing
import os
import platform
import sys
import traceback
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("NUMBA_NUM_THREADS", "1")

from tests.performance.calibration import kernel_ms
from tests.performance.figures import PARTS, Figure, as_document

ANSWERS = {True: "yes", False: "no", None: ""}


def row(figure: Figure) -> str:
    """A line of the table."""
    sign = "<=" if figure.at_most else ">="
    goal = "" if figure.goal is None else f"{sign} {figure.goal:g}"
    value = f"{figure.value:.3g} {figure.unit}"
    return f"{figure.name:<48}{value:>12}{goal:>10} {ANSWERS[figure.met]:<5}{figure.ratio:>8.2f} times {figure.peer}"


def measure(part: str) -> list[Figure]:
    """The figures of one part, in a process of its own: one libsumo per process, and no kernels of another part."""
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, mp_context=context) as process:
        return process.submit(PARTS[part]).result()


def main(parts: list[str]) -> int:
    """Measures the parts, and returns the exit code."""
    figures: dict[str, list[Figure]] = {}
    broken: dict[str, str] = {}
    for part in parts:
        print(f"measuring: {part}", file=sys.stderr, flush=True)
        try:
            figures[part] = measure(part)
        except Exception as error:  # one broken part must not hide the others
            traceback.print_exc()
            broken[part] = f"{type(error).__name__}: {error}"
    calibration = kernel_ms()
    document = {
        "python": sys.version.split()[0],
        "machine": platform.machine(),
        "cpus": os.cpu_count(),
        "load": os.getloadavg()[0],
        "kernel_ms": calibration,
        "figures": [{"part": part, **as_document(one)} for part, some in figures.items() for one in some],
        "broken": broken,
    }
    Path("bench.json").write_text(json.dumps(document, indent=1) + "\n")
    print(f"{'figure':<48}{'measured':>12}{'goal':>10} {'met':<5}{'ratio to its peer':>20}")
    for some in figures.values():
        for one in some:
            print(row(one))
    print(f"calibration kernel {calibration:.2f} ms, {os.cpu_count()} processors, load {os.getloadavg()[0]:.1f}")
    for part, reason in broken.items():
        print(f"broken: {part}: {reason}")
    return 1 if broken else 0


if __name__ == "__main__":
    unknown = [name for name in sys.argv[1:] if name not in PARTS]
    if unknown:
        sys.exit(f"expected parts of {', '.join(PARTS)}, got {', '.join(unknown)}")
    sys.exit(main(sys.argv[1:] or list(PARTS)))
