"""How long a picture takes, on one core: each sensor that draws, before a signalised junction of adlershof.

    OMP_NUM_THREADS=1 python -m tests.performance.senses

Nothing is simulated: vehicles stand on the lanes and people on the sidewalks around the ego. While it is read, the ego
moves along its route, so that tiles and surroundings are renewed as in a drive. "fresh" is the first picture of a
process that has compiled kernels, with all its tiles.
"""

from __future__ import annotations

import dataclasses
import itertools
import json
import sys
import time

import numpy as np

from dohyo.sumo_networks.conditions import CONDITIONS
from dohyo.sumo_networks.networks.catalog import load_network
from dohyo.sumo_networks.networks.network import RoadNetwork
from dohyo.sumo_networks.scenario import Mission, Place
from dohyo.sumo_networks.sensors import PRESETS, SensorConfig, make_sensors
from dohyo.sumo_networks.world import ActorKind, World
from tests.worlds import Scene, straight_road

MISSION = Mission(start=Place(lane="46039050#0_2", position_m=8.0), goal=Place(lane="414563781_4", position_m=-15.0))
BEFORE_M = 25.0
READINGS = 400
STEP_M = 0.5
COUNTS = (40, 100)
SIZES = {
    ActorKind.CAR: (4.6, 1.8),
    ActorKind.VAN: (6.2, 2.1),
    ActorKind.BUS: (12.0, 2.5),
    ActorKind.BICYCLE: (1.7, 0.65),
}


def crowd(network: RoadNetwork, x: float, y: float, count: int) -> list[tuple[ActorKind, float, float, float]]:
    """Kind, x, y [m] and heading [rad] of so many actors: three of five drive, nearest first."""
    found: dict[bool, list[tuple[float, float, float, float]]] = {True: [], False: []}
    lanes = network.lanes
    for lane in np.flatnonzero((lanes.drivable | lanes.pedestrian) & ~lanes.internal & ~lanes.crossing).tolist():
        if str(lanes.ids[lane]).startswith(":") or np.hypot(*(network.lane_shape(lane) - (x, y)).T).min() > 150.0:
            continue
        for position in np.arange(4.0, float(lanes.length[lane]) - 4.0, 9.0):
            px, py, heading = network.lane_point(lane, float(position))
            found[bool(lanes.drivable[lane])].append((float(np.hypot(px - x, py - y)), px, py, heading))
    kinds = itertools.cycle(
        (ActorKind.CAR, ActorKind.CAR, ActorKind.VAN, ActorKind.CAR, ActorKind.BUS, ActorKind.BICYCLE)
    )
    driving = [(next(kinds), *place[1:]) for place in sorted(found[True]) if 7.0 < place[0] < 98.0][: count * 3 // 5]
    walking = [(ActorKind.PEDESTRIAN, *place[1:]) for place in sorted(found[False]) if place[0] < 98.0]
    return driving + walking[: count - len(driving)]


def junction(count: int) -> list[World]:
    """The worlds of an ego that comes to a light among so many actors."""
    network = load_network("adlershof")
    scene = Scene(network, MISSION)
    light = next(passage for passage in scene.route.passages if passage.signal >= 0)
    row = scene.route.index(light.entry - BEFORE_M)
    (x, y), heading = scene.route.position[row], float(scene.route.heading[row])
    for kind, px, py, direction in crowd(network, x, y, count):
        length, width = SIZES.get(kind, (0.5, 0.5))
        scene = scene.with_actor(px, 5.0, kind=kind, y=py, heading=direction, length=length, width=width)
    start = scene.with_ego(x, y=y, heading=heading).world()
    worlds = []
    for step in range(round(10.0 / STEP_M)):
        here = start.egos.position + step * STEP_M * np.array([[np.cos(heading), np.sin(heading)]])
        worlds.append(dataclasses.replace(start, egos=dataclasses.replace(start.egos, position=here)))
    return worlds


def measure(config: SensorConfig, worlds: list[World], conditions: str = "clear") -> dict[str, float]:
    """Milliseconds of the first picture, and of later ones."""
    make_sensors([config])[0].read(straight_road().with_ego(x=100.0).world(), 0)  # compiles
    (sensor,) = make_sensors([config], conditions=CONDITIONS[conditions])
    times = []
    for world in itertools.islice(itertools.cycle(worlds), READINGS):
        began = time.perf_counter()
        sensor.read(world, 0)
        times.append(1e3 * (time.perf_counter() - began))
    later = np.array(times[len(worlds) :])
    values = times[0], np.median(later), np.percentile(later, 10)
    return {name: round(float(value), 3) for name, value in zip(("fresh", "median", "p10"), values, strict=True)}


def main() -> None:
    """Prints the table, and with --json a document instead."""
    rows = {}
    for count in COUNTS:
        worlds = junction(count)
        for config in PRESETS:
            rows[f"{config.name}, {count} actors"] = measure(config, worlds)
    rain = next(preset for preset in PRESETS if preset.name == "camera_rgb")
    rows["camera_rgb, 100 actors, heavy-rain"] = measure(rain, worlds, "heavy-rain")
    if "--json" in sys.argv:
        print(json.dumps(rows, indent=1))
        return
    print(f"{'sensor':<36}{'median ms':>11}{'p10 ms':>9}{'fresh ms':>10}")
    for name, row in rows.items():
        print(f"{name:<36}{row['median']:>11}{row['p10']:>9}{row['fresh']:>10}")


if __name__ == "__main__":
    main()
