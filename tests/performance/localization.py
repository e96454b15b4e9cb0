"""How long radar, IMU, GNSS and the filters take; `make bench` prints it."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from dohyo.agents.localization.filters.base import Filter, FilterNoise, InitialState
from dohyo.agents.localization.filters.measurements import AntennaPosition
from dohyo.agents.localization.localizer import FILTERS
from dohyo.sumo_networks.sensors import make_sensors
from dohyo.sumo_networks.world import World

ROUNDS, CALLS = 15, 400
SENSORS = ("radar", "imu", "gnss")
FORCE, RATE = np.array([0.5, 1.0, 9.8]), np.array([0.0, 0.0, 0.1])


def microseconds(call: Callable[[], object], calls: int = CALLS) -> float:
    """Of one call: the median over rounds, so that a slow moment of the machine does not count."""
    call()
    rounds = []
    for _ in range(ROUNDS):
        began = time.perf_counter()
        for _ in range(calls):
            call()
        rounds.append(1e6 * (time.perf_counter() - began) / calls)
    return round(float(np.median(rounds)), 2)


def sensors(world: World) -> dict[str, float]:
    """Microseconds per reading of the first ego of a world."""
    made = make_sensors(SENSORS)
    return {f"{sensor.name}_us": microseconds(lambda s=sensor: s.read(world, 0)) for sensor in made}  # type: ignore[misc]


def filters() -> dict[str, float]:
    """Microseconds per IMU sample and per fix of every filter."""
    start = InitialState(np.zeros(3), np.array([8.0, 0.0, 0.0]), 0.3, 0.5, 0.1, 0.05)
    out = {}
    for name in ("es-ekf", "ekf", "ukf"):
        filter_: Filter = FILTERS[name](start, FilterNoise())
        calls = CALLS if name != "ukf" else 40
        # A fix now and then, or the covariance would grow without bounds.
        filter_.correct(AntennaPosition.of(filter_.position, 0.5))
        out[f"{name}_imu_us"] = microseconds(lambda f=filter_: f.predict(FORCE, RATE, 0.01), calls)  # type: ignore[misc]
        out[f"{name}_fix_us"] = microseconds(lambda f=filter_: f.correct(AntennaPosition.of(f.position, 0.5)), calls)  # type: ignore[misc]
    return out


def report(world: World) -> dict[str, float]:
    """All of it, printed."""
    results = sensors(world) | filters()
    for name, value in results.items():
        print(f"{name:<16}{value:>9} us")
    return results
