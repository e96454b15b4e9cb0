"""How long GHRL's state takes: one picture encoded, and a whole state with pictures, without, and with a filter.

An ego drives among ten others on a hand-made road; sensors are not timed. Medians, and the fastest tenth, in
milliseconds on one core. `python -m tests.performance.state`
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("NUMBA_NUM_THREADS", "1")

import numpy as np

from dohyo.agents.hierarchical.state.state import StateConfig, StateEncoder
from dohyo.agents.hierarchical.vision.latents import Encoder
from dohyo.sumo_networks.sensors import make_sensors
from tests.worlds import straight_road

REPEATS = 500
GOALS = {"picture": 3.0}


def timed(call: Callable[[], object]) -> tuple[float, float]:
    """Median and fastest tenth, ms."""
    call()
    took = []
    for _ in range(REPEATS):
        began = time.perf_counter()
        call()
        took.append(1e3 * (time.perf_counter() - began))
    return float(np.median(took)), float(np.percentile(took, 10))


def measure() -> dict[str, tuple[float, float]]:
    """Median and fastest tenth of each, ms."""
    rng, scene = np.random.default_rng(0), straight_road().with_ego(x=200.0, speed=8.0)
    for _ in range(10):
        scene = scene.with_actor(x=200.0 + rng.uniform(-40, 60), left=3.2 * int(rng.integers(-1, 3)), speed=8.0)
    world, encoder = scene.world(), Encoder()
    states = {
        "state, pictures": StateEncoder(StateConfig()),
        "state, none": StateEncoder(StateConfig(vision="none")),
        "state, none, es-ekf": StateEncoder(StateConfig(vision="none", localization="es-ekf")),
    }
    names = dict.fromkeys(name for state in states.values() for name in state.sensors)
    observation = {sensor.name: sensor.read(world, 0) for sensor in make_sensors(names)}
    rows = {"picture": timed(lambda: encoder.latent(observation["camera_semantic"]))}
    rows |= {name: timed(lambda state=state: state.encode(observation)) for name, state in states.items()}
    return rows


def main() -> None:
    """Measures and prints."""
    for name, (median, fastest) in measure().items():
        goal = f"  goal {GOALS[name]:.1f}" if name in GOALS else ""
        print(f"{name:<22} {median:6.3f} {fastest:6.3f}{goal}")


if __name__ == "__main__":
    main()
