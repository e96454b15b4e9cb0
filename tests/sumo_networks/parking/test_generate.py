"""Drawn lots: valid, repeatable, and each scene is what it says."""

from __future__ import annotations

import hashlib
import math
from itertools import product

import numpy as np
import pytest

from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.parking import kart
from dohyo.sumo_networks.parking.generate import Scene
from dohyo.sumo_networks.parking.lot import SpotKind
from dohyo.sumo_networks.parking.tables import FREE, TARGET
from dohyo.sumo_networks.parking.world import ParkingWorld
from dohyo.sumo_networks.seeds import HELD_OUT_FROM

LOTS = 60


def drawn(scene: Scene, karts: int = 1) -> ParkingWorld:
    world = ParkingWorld(LOTS, karts)
    world.draw(range(LOTS), range(7, 7 + LOTS), scene)
    return world


@pytest.mark.parametrize(("scene", "karts"), [(scene, karts) for scene in Scene for karts in (1, 3)])
def test_every_drawn_lot_is_a_valid_lot_that_drives_the_same(scene, karts):
    """`Lot` refuses overlaps, contacts, and lots without a free spot."""
    world, given = drawn(scene, karts), ParkingWorld(LOTS, karts)
    for lot in range(LOTS):
        described = world.lot(lot)
        given.place(lot, type(described).model_validate_json(described.model_dump_json()))
        free = np.flatnonzero(world.view(lot).spots[:, FREE]).tolist()
        assert list(described.free_spots) == free
        assert len(free) >= karts
    actions = np.random.default_rng(0).uniform(-1, 1, (20, LOTS, karts, 3))
    for action in actions:
        assert np.array_equal(world.step(action), given.step(action))
        assert np.array_equal(world.observations, given.observations)


@pytest.mark.parametrize(
    ("scene", "karts", "seed"),
    [(Scene.COMPLEX, 3, 4215), (Scene.COMPLEX, 5, 9), (Scene.ANGLED, 3, 1548), (Scene.ANGLED, 5, 2250)],
)
def test_no_kart_starts_in_a_parked_car(scene, karts, seed):
    """The first start drawn for a kart of these rare lots is in a car; `Lot` refuses such a start."""
    world = ParkingWorld(1, karts)
    world.draw([0], [HELD_OUT_FROM + seed], scene)
    assert len(world.lot(0).karts) == karts


@pytest.mark.parametrize("scene", [Scene.COMPLEX, Scene.ANGLED, Scene.PEDESTRIANS])
def test_karts_for_which_no_start_was_drawn_start_in_a_free_place(scene):
    """In one of a hundred lots of 8 karts all draws of a start fail. `Lot` refuses contact; the walls are a box."""
    world = ParkingWorld(1000, 8)
    world.draw(range(1000), range(1000), scene)
    for lot in range(1000):
        view = world.view(lot)
        inside = np.abs(view.karts[:, [kart.X, kart.Y]]) < np.abs(view.walls[:, :2]).max(axis=0) - 1.2
        assert inside.all(), lot
        north = np.isclose(view.karts[:, kart.HEADING], math.pi / 2)
        assert not north.any() or len(world.lot(lot).karts) == 8


DRAWN = "060a5d92968e5d4815b64066a6063e7cfa27cf04744efe2414a4a4a7842d532a"


def test_lots_are_those_of_earlier_versions():
    """Benchmarks and trainings know lots by their seeds alone; walls to starts, to the micrometre."""
    digest = hashlib.sha256()
    for scene, karts in product(Scene, (1, 3, 5)):
        world = drawn(scene, karts)
        for lot in range(LOTS):
            view = world.view(lot)
            for rows in (view.walls, view.boxes, view.spots, view.walkers, view.karts):
                digest.update((np.round(rows, 6) + 0.0).tobytes())
    assert digest.hexdigest() == DRAWN


@pytest.mark.parametrize(("scene", "most"), [(scene, 5 if scene == Scene.PARALLEL else 8) for scene in Scene])
def test_every_kart_has_a_spot_and_more_karts_than_spots_are_refused(scene, most):
    world = drawn(scene, most)
    assert min(len(world.view(lot).spots) for lot in range(LOTS)) >= most
    if most < 8:
        with pytest.raises(InvalidInputError, match=f"at most {most} karts in a lot of the scene 'parallel'.*, got 6$"):
            drawn(scene, most + 1)


def test_lots_differ_by_seed_and_by_scene_and_not_otherwise():
    one, same = drawn(Scene.COMPLEX).observations, drawn(Scene.COMPLEX).observations
    assert np.array_equal(one, same)
    assert len(np.unique(one.reshape(LOTS, -1), axis=0)) == LOTS
    assert (one != drawn(Scene.PEDESTRIANS).observations).any(axis=(1, 2)).all()


@pytest.mark.parametrize(("scene", "nearest_m", "farthest_m"), [(Scene.SIMPLE, 4.9, 30.0), (Scene.COMPLEX, 10.0, 70.0)])
def test_spots_are_as_far_as_the_scene_says(scene, nearest_m, farthest_m):
    distances = drawn(scene).results().distance_m
    assert nearest_m < distances.min()
    assert distances.max() < farthest_m
    assert distances.max() - distances.min() > 15.0


def test_starts_face_all_directions():
    headings = drawn(Scene.COMPLEX).tables.karts[:, kart.HEADING]
    assert np.histogram(headings, 4, (-math.pi, math.pi))[0].min() > 0


@pytest.mark.parametrize(
    ("scene", "kind"),
    [
        (Scene.COMPLEX, SpotKind.PERPENDICULAR),
        (Scene.PARALLEL, SpotKind.PARALLEL),
        (Scene.ANGLED, SpotKind.ANGLED),
        (Scene.PEDESTRIANS, SpotKind.PERPENDICULAR),
    ],
)
def test_spots_have_the_kind_of_the_scene(scene, kind):
    world = drawn(scene)
    assert {spot.kind for lot in range(LOTS) for spot in world.lot(lot).spots} == {kind}
    assert any(world.lot(lot).pedestrians for lot in range(LOTS)) == (scene == Scene.PEDESTRIANS)


def test_the_nearest_free_spot_is_the_target():
    world = drawn(Scene.COMPLEX)
    for lot in range(LOTS):
        view = world.view(lot)
        away = np.hypot(*(view.spots[:, :2] - view.karts[0, [kart.X, kart.Y]]).T)
        assert view.counts[0, TARGET] == np.where(view.spots[:, FREE] == 1, away, np.inf).argmin()
