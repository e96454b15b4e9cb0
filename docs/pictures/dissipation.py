"""Draws docs/pictures/dissipation.png: one morning's speeds, uncontrolled and with a plan that 5 % follow.

Run it with `.venv/bin/python docs/pictures/dissipation.py` (some minutes; needs chromium).
`--maps FOLDER` keeps what it drove.
"""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path

import numpy as np
from space_time import SpeedMap, side_by_side, write_picture

from dohyo.agents.speed_planning.study.dissipation import LeadIn, Morning, controlled, is_observed
from dohyo.agents.speed_planning.study.mornings import ARMS, in_a_copy
from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.freeway import FreewaySimulation, load_freeway
from dohyo.sumo_networks.freeway.measure import SpaceTimeMap

PICTURE = Path(__file__).with_suffix(".png")
SEED = 5
"""Of the ten mornings of the study the one with the median change of deviation."""
SHOWN = {
    "none": "nothing is controlled",
    "rule+persistence": "every twentieth car follows the plan",
}
"""Arms and what stands above them."""
MORNING = Morning()
CELL_S, CELL_M = 30.0, 200.0


def drive(lead_in: LeadIn, arm: str, path: Path) -> None:
    """Writes the (time, space) mean speeds of one arm, m/s."""
    grid = SpaceTimeMap(lead_in.simulation.road, MORNING.start_s, MORNING.duration_s, CELL_S, CELL_M)
    for world in controlled(lead_in, ARMS[arm], MORNING):
        if is_observed(world.time_s):
            grid.observe(world)
    np.save(path, grid.speed_mps())


def driven(folder: Path) -> list[FloatArray]:
    """The arms' speeds, driven where they are not there."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = {arm: folder / f"{arm}.npy" for arm in SHOWN}
    missing = [arm for arm, path in paths.items() if not path.exists()]
    if missing:
        with FreewaySimulation(MORNING.scenario(SEED), fuel=False) as simulation:
            lead_in = LeadIn.driven(simulation, SEED, MORNING.start_s)
            for arm in missing:
                in_a_copy(arm, partial(drive, lead_in, arm, paths[arm]))
    return [np.load(path) for path in paths.values()]


def speed_map(speed_mps: FloatArray, title: str) -> SpeedMap:
    """A map as it is drawn."""
    times, cells = speed_mps.shape
    hour = (MORNING.start_s + CELL_S * (np.arange(times) + 0.5)) / 3600
    return SpeedMap(hour, (np.arange(cells) + 0.5) * CELL_M / 1000, speed_mps, title)


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--maps", type=Path, default=Path("out/dissipation-maps"))
    speeds = driven(parser.parse_args().maps)
    figure = side_by_side(
        [speed_map(speed, title) for speed, title in zip(speeds, SHOWN.values(), strict=True)],
        load_freeway(),
        "A few slower cars upstream spread a breakdown out",
        f"Mean speeds of all vehicles in {CELL_S:.0f} s and {CELL_M:.0f} m; the same vehicles at the same times in "
        f"both. Seed {SEED}: of ten mornings the one with the median change of deviation.",
    )
    write_picture(figure, PICTURE)


if __name__ == "__main__":
    main()
