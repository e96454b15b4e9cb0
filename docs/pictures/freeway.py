"""Draws docs/pictures/freeway.png: one morning's stop-and-go waves, with single vehicles and with queues.

Run it with `.venv/bin/python docs/pictures/freeway.py` (some minutes; needs chromium).
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from space_time import SpeedMap, side_by_side, write_picture

from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.freeway import FreewayScenario, FreewaySimulation, load_freeway
from dohyo.sumo_networks.freeway.days import drive_day
from dohyo.sumo_networks.freeway.measure import SpaceTimeMap, wave_speed

PICTURE = Path(__file__).with_suffix(".png")
MORNING = FreewayScenario(seed=1, start_s=6.7 * 3600, duration_s=4200.0, warm_up_s=600.0)
WHOLE = MORNING.model_copy(update={"start_s": 5.0 * 3600, "duration_s": 5.5 * 3600})
CELL_S, CELL_M, LOOK_S = 10.0, 100.0, 2.0
CONGESTED_M, BEFORE_M = 3000.0, 8500.0


def vehicles() -> FloatArray:
    """(time, space) mean speeds of the morning with single vehicles, m/s."""
    with FreewaySimulation(MORNING, fuel=False) as simulation:
        grid = SpaceTimeMap(simulation.road, MORNING.start_s, MORNING.duration_s, CELL_S, CELL_M)
        while simulation.world.time_s < MORNING.start_s + MORNING.duration_s:
            if simulation.world.time_s % LOOK_S == 0:
                grid.observe(simulation.world)
            simulation.tick()
    return grid.speed_mps()


def main() -> None:
    """Drives both, draws them side by side, and prints how fast the waves travel."""
    road = load_freeway()
    micro = vehicles()
    meso = drive_day(WHOLE, "meso")
    part = micro[:, int(CONGESTED_M / CELL_M) : int(BEFORE_M / CELL_M)]
    kmh = 3.6 * wave_speed(part[len(part) // 3 :], CELL_S, CELL_M)
    print(f"waves travel at {kmh:.1f} km/h")
    hours = (MORNING.start_s + CELL_S * (np.arange(len(micro)) + 0.5)) / 3600
    figure = side_by_side(
        [
            SpeedMap(hours, (np.arange(micro.shape[1]) + 0.5) * CELL_M / 1000, micro),
            SpeedMap((meso.minute + 0.5) / 60, road.bounds_m / 1000, meso.truth.speed_mps),
        ],
        road,
        f"Stop-and-go waves leave the bottleneck upstream at {abs(kmh):.0f} km/h",
        f"Left: every vehicle simulated, means of {CELL_S:.0f} s and {CELL_M:.0f} m. Right: the same morning in "
        "queues, means of minutes and segments. A Tuesday, seed 1; nothing is controlled.",
        widths=(0.56, 0.44),
    )
    write_picture(figure, PICTURE)


if __name__ == "__main__":
    main()
