"""SUMO on a freeway: its start, and its options for single vehicles (micro) and for queues (meso)."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import libsumo

from dohyo.sumo_networks.errors import SimulationError

TICK_S = 0.5
MICRO = (
    *("--step-length", str(TICK_S), "--lanechange.duration", "0", "--time-to-teleport", "300"),
    *("--collision.action", "warn", "--collision.mingap-factor", "0", "--extrapolate-departpos", "true"),
)
MESO = (
    *("--mesosim", "true", "--step-length", "1", "--time-to-teleport", "-1", "--meso-edgelength", "200"),
    *("--meso-tauff", "1.2", "--meso-taufj", "1.2", "--meso-taujf", "1.7", "--meso-taujj", "1.45"),
)
_QUIET = (
    *("--xml-validation", "never", "--no-step-log", "true", "--no-warnings", "true", "--duration-log.disable", "true"),
)


def start_sumo(net: Path, files: Iterable[Path], begin_s: float, seed: int, options: Iterable[str]) -> None:
    """Starts SUMO in this process.

    Args:
        net: Path of the SUMO net.
        files: The route file, then additional files.
        begin_s: Time of day, s since midnight.
        seed: Seed of SUMO's own random numbers.
        options: `MICRO` or `MESO`.

    Raises:
        SimulationError: Another simulation of this process is open, or SUMO could not load one of the files.
    """
    if libsumo.isLoaded():
        raise SimulationError(
            "another simulation of this process is still open; close it, or use one process per simulation"
        )
    routes, *others = [str(file) for file in files]
    additional = ("--additional-files", ",".join(others)) if others else ()
    command = ["sumo", "-n", str(net), "-r", routes, *additional, "--begin", f"{begin_s:g}", "--seed", str(seed)]
    try:
        libsumo.start([*command, *options, *_QUIET])
    except libsumo.TraCIException as error:
        libsumo.close()  # SUMO stays open after a failed load
        raise SimulationError(
            f"SUMO could not load the freeway from '{net}': {' '.join(str(error).split())}"
        ) from error
