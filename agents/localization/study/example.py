"""Example: the logs of a simulated drive, as a car writes them, to try `dohyo localize` on.

The drive begins rolling; the IMU shakes and is not calibrated; the receiver has a fix a second, is silent for 10 s
after every 20 s, and one fix in twenty is wild.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from dohyo.agents.localization.study.robustness import VIBRATION, Case, fixes_of, rolling_journey
from dohyo.agents.localization.study.synthetic import record
from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.files import write_atomically
from dohyo.sumo_networks.sensors.gnss import GnssNoise
from dohyo.sumo_networks.sensors.imu import ICM_20600

CASE = Case("robust", outage_s=10.0, sigma_m=1.0, route="roundabout", seed=4)


def write_example(folder: Path) -> list[Path]:
    """Writes imu.csv, gnss.csv and truth.csv; the same files at each call.

    Raises:
        InvalidInputError: They cannot be written.
    """
    journey = rolling_journey(CASE.route)
    noise = GnssNoise(CASE.sigma_m, correlated_share=0.0, rate_hz=1.0)
    recording = record(journey, replace(ICM_20600, vibration=VIBRATION), noise, np.random.default_rng(CASE.seed))
    fixes = fixes_of(CASE, journey, recording.fix_rows, recording.fixes, np.random.default_rng([CASE.seed, 1]))
    tables = {
        "imu": ("t,ax,ay,az,gx,gy,gz", np.column_stack([journey.time, recording.imu])),
        "gnss": ("t,x,y,z", np.array([[fix.time, *fix.position] for fix in fixes])),
        "truth": ("t,x,y", np.column_stack([journey.time, journey.position])[::10]),
    }
    try:
        folder.mkdir(parents=True, exist_ok=True)
        return [_write(folder / f"{name}.csv", head, table) for name, (head, table) in tables.items()]
    except OSError as error:
        raise InvalidInputError(f"cannot write into '{folder}': {error.strerror}") from error


def _write(path: Path, head: str, table: FloatArray) -> Path:
    rows = [",".join(f"{value:.6g}" if abs(value) < 1.0 else f"{value:.4f}" for value in row) for row in table]
    write_atomically(path, ("\n".join([head, *rows]) + "\n").encode())
    return path
