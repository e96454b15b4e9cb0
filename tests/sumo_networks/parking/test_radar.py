"""Radar: distances and kinds against shapely, in drawn lots and in one that is seen at a glance."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely

from dohyo.sumo_networks.parking import kart
from dohyo.sumo_networks.parking.generate import Scene
from dohyo.sumo_networks.parking.lot import ParkedCar, Pedestrian, Pose, Wall
from dohyo.sumo_networks.parking.observation import PER_RAY, RADAR
from dohyo.sumo_networks.parking.radar import BEARINGS_RAD, RANGE_M, Kind
from dohyo.sumo_networks.parking.tables import KIND, OUTCOME, WALK_RADIUS, WALK_X, WALK_Y
from dohyo.sumo_networks.parking.world import ParkingWorld
from tests.sumo_networks.parking.lots import lot_of, world_of


def seen(world: ParkingWorld, lot: int = 0, number: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """(9,) distances [m] and kinds of a kart's observation."""
    rays = world.observations[lot, number, RADAR:].reshape(-1, PER_RAY)
    return rays[:, 0] * RANGE_M, np.where(rays[:, 1:].any(axis=1), 1 + rays[:, 1:].argmax(axis=1), 0)


def oriented(x: float, y: float, heading: float, length: float, width: float) -> shapely.Geometry:
    flat = shapely.box(x - length / 2, y - width / 2, x + length / 2, y + width / 2)
    return shapely.affinity.rotate(flat, heading, origin=(x, y), use_radians=True)


def expected(world: ParkingWorld, lot: int, number: int) -> tuple[list[float], list[int]]:
    """Distances and kinds by shapely."""
    view, found = world.view(lot), []
    found += [(Kind.WALL, shapely.LineString(row.reshape(2, 2))) for row in view.walls]
    found += [(Kind(int(row[KIND])), oriented(*row[:5])) for row in view.boxes]
    found += [
        (Kind.PEDESTRIAN, shapely.Point(row[WALK_X], row[WALK_Y]).buffer(row[WALK_RADIUS], quad_segs=512))
        for row in view.walkers
    ]
    for other, row in enumerate(view.karts):
        if other != number and view.counts[other, OUTCOME] != 7:
            box = oriented(row[kart.X], row[kart.Y], row[kart.HEADING], kart.LENGTH_M, kart.WIDTH_M)
            found.append((Kind.KART, box))
    own = view.karts[number]
    start, distances, kinds = shapely.Point(own[kart.X], own[kart.Y]), [], []
    for bearing in own[kart.HEADING] + BEARINGS_RAD:
        end = (start.x + RANGE_M * math.cos(bearing), start.y + RANGE_M * math.sin(bearing))
        ray = shapely.LineString([(start.x, start.y), end])
        hits = [(start.distance(ray.intersection(shape)), kind) for kind, shape in found if ray.intersects(shape)]
        distance, kind = min(hits, default=(RANGE_M, Kind.NOTHING))
        distances.append(distance)
        kinds.append(int(kind))
    return distances, kinds


@pytest.mark.parametrize("scene", [Scene.COMPLEX, Scene.ANGLED, Scene.PEDESTRIANS])
def test_rays_in_drawn_lots_meet_what_shapely_meets(scene):
    world, met = ParkingWorld(6, 3), set()
    world.draw(range(6), range(6), scene)
    for _ in range(3):
        for lot, number in np.argwhere(world.running).tolist():
            distances, kinds = seen(world, lot, number)
            true_distances, true_kinds = expected(world, lot, number)
            assert np.allclose(distances, true_distances, atol=1e-3)
            assert kinds.tolist() == true_kinds
            met |= set(true_kinds)
        for _ in range(15):
            world.step(np.broadcast_to([0.6, 0.3, -1.0], (6, 3, 3)))
    assert met >= {Kind.WALL, Kind.CAR, Kind.KART}
    assert (Kind.PEDESTRIAN in met) == (scene == Scene.PEDESTRIANS)


def test_the_middle_ray_looks_ahead_and_the_last_one_left():
    car = ParkedCar(x_m=12.0, y_m=0.0, heading_rad=0.0, length_m=4.0, width_m=2.0)
    walker = Pedestrian(x0_m=5.0, y0_m=5.0 * math.tan(math.radians(60)), x1_m=0.0, y1_m=30.0, speed_mps=0.0)
    wall = Wall(x0_m=-50.0, y0_m=-20.0, x1_m=50.0, y1_m=-20.0)
    spot = {"spots": (lot_of(Pose(x_m=20, y_m=0)).spots[0].model_copy(update={"y_m": 20.0}),)}
    distances, kinds = seen(
        world_of(lot_of(Pose(x_m=0, y_m=0), cars=(car,), pedestrians=(walker,), walls=(wall,), **spot))
    )
    assert (kinds[4], distances[4]) == (Kind.CAR, pytest.approx(10.0, abs=1e-4))
    assert (kinds[8], distances[8]) == (Kind.PEDESTRIAN, pytest.approx(10.0 - 0.3, abs=1e-4))
    assert (kinds[0], distances[0]) == (Kind.WALL, pytest.approx(20.0 / math.sin(math.radians(60)), abs=1e-4))
    assert (kinds[6], distances[6]) == (Kind.NOTHING, RANGE_M)
