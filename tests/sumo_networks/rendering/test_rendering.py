from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from dohyo.sumo_networks.networks.catalog import load_network
from dohyo.sumo_networks.rendering import buildings
from dohyo.sumo_networks.rendering.atmosphere import GROUND_COLOURS
from dohyo.sumo_networks.rendering.bodies import HEIGHT_M, PARTS, PARTS_START, own_colours
from dohyo.sumo_networks.rendering.buildings import buildings_near
from dohyo.sumo_networks.rendering.fixtures import fixtures_of
from dohyo.sumo_networks.rendering.surfaces import CellIndex, Surface, ground_of
from dohyo.sumo_networks.rendering.tiles import CAPACITY, SIDE_PX, Tiles, rasterise
from dohyo.sumo_networks.world import ActorKind
from tests.worlds import (
    LANE_M,
    _build,
    _road,
    crossing_for_pedestrians,
    lit_crossing,
    stop_sign_crossing,
    straight_road,
)

COLOURS = np.array(GROUND_COLOURS, dtype=np.float64)


# Tiles


def test_however_far_one_drives_the_tiles_take_no_more_memory() -> None:
    tiles = Tiles(ground_of(straight_road().network), 0.1, COLOURS, capacity=6)
    size = tiles.pool.nbytes
    for x in np.arange(0.0, 10_000.0, tiles.side_m):
        tiles.table(x, -1.0, x + 1.0, 1.0)
        assert len(tiles) <= 6
    assert tiles.pool.nbytes == size == 6 * SIDE_PX**2 * 4
    assert tiles.generation > 300


def test_the_tiles_of_a_ten_kilometre_net_fit_in_memory() -> None:
    """Five resolutions of colours are the most that a camera uses."""
    assert 5 * CAPACITY * SIDE_PX**2 * 4 < 170e6


def test_a_forgotten_tile_is_drawn_again_as_it_was() -> None:
    tiles = Tiles(ground_of(lit_crossing().network), 0.1, COLOURS, capacity=2)
    (((slot,),), *_) = tiles.table(-12.0, -1.0, -12.0, -1.0)
    first = tiles.pool[slot].copy()
    assert len(np.unique(first)) > 2
    tiles.table(100.0, 0.0, 100.0, 0.0)
    tiles.table(130.0, 0.0, 130.0, 0.0)
    (((slot,),), *_) = tiles.table(-12.0, -1.0, -12.0, -1.0)
    np.testing.assert_array_equal(tiles.pool[slot], first)


def test_a_view_that_takes_more_tiles_than_are_kept_is_refused() -> None:
    tiles = Tiles(ground_of(straight_road().network), 0.1, COLOURS, capacity=4)
    with pytest.raises(ValueError, match="at most 4 tiles"):
        tiles.table(0.0, 0.0, 100.0, 100.0)


def test_tiles_join_without_a_seam() -> None:
    ground = ground_of(lit_crossing().network)
    tiles = Tiles(ground, 0.17, None)
    table, left, bottom = tiles.table(-60.0, -60.0, 60.0, 60.0)
    joined = np.vstack([np.hstack([tiles.pool[slot, :256, :256] for slot in row]) for row in table])
    at_once = rasterise(ground, left * tiles.side_m, bottom * tiles.side_m, joined.shape[0], 0.17, 3.0)
    assert (joined != at_once[: joined.shape[0], : joined.shape[1]]).mean() < 1e-4
    for row in table:
        for one, beside in pairwise(row):
            np.testing.assert_array_equal(tiles.pool[one, :, 256], tiles.pool[beside, :, 0])


@given(st.integers(0, 2**32 - 1), st.floats(-50, 50), st.floats(-50, 50), st.floats(0, 90))
def test_the_index_finds_every_point_in_a_rectangle(seed: int, x: float, y: float, side: float) -> None:
    points = np.random.default_rng(seed).uniform(-100, 100, (200, 2))
    cells = CellIndex(points)
    found = set(cells.order[cells.near(x, y, x + side, y + side)].tolist())
    inside = (points >= (x, y)).all(axis=1) & (points <= (x + side, y + side)).all(axis=1)
    assert set(np.flatnonzero(inside).tolist()) <= found


def test_of_nothing_the_index_finds_nothing() -> None:
    assert not len(CellIndex(np.empty((0, 2))).near(-1.0, -1.0, 1.0, 1.0))


# The ground


@pytest.mark.parametrize(
    ("x", "y", "surface"),
    [
        (500.0, -1.6, Surface.ROAD),
        (500.0, 0.0, Surface.LINE),
        (500.0, -6.5, Surface.KERB),
        (500.0, -9.0, Surface.TERRAIN),
    ],
)
def test_what_lies_on_a_straight_road(x: float, y: float, surface: Surface) -> None:
    assert rasterise(ground_of(straight_road().network), x, y - 0.01, 1, 0.02, 0.0)[0, 0] == surface


def test_a_zebra_crossing_has_stripes_across_the_way_of_cars() -> None:
    network = crossing_for_pedestrians().network
    lane = int(np.flatnonzero(network.lanes.crossing)[0])
    x, y = network.lane_shape(lane).mean(axis=0)
    patch = rasterise(ground_of(network), x - 2.0, y - 2.0, 200, 0.02, 0.0)
    shares = [np.mean(patch == surface) for surface in (Surface.STRIPE, Surface.CROSSING)]
    assert shares == pytest.approx([0.5, 0.5], abs=0.12)


def test_stop_lines_end_at_the_stop_line() -> None:
    scene = lit_crossing()
    x = scene.stop_line("w_c_0")
    row = rasterise(ground_of(scene.network), x - 1.0, -4.8, 100, 0.02, 0.0)[0]
    assert np.flatnonzero(row == Surface.STOP_LINE) * 0.02 - 1.0 == pytest.approx(np.arange(-0.5, 0.0, 0.02), abs=0.021)


@pytest.mark.parametrize(
    ("allow", "surface"),
    [
        pytest.param('allow="bus"', Surface.ROAD, id="a street for buses"),
        pytest.param('allow="delivery"', Surface.ROAD, id="a street for deliveries"),
        pytest.param('allow="bus tram"', Surface.ROAD, id="a street for buses and trams"),
        pytest.param('disallow="passenger bicycle pedestrian"', Surface.ROAD, id="a street closed to cars"),
        pytest.param('allow="bus bicycle"', Surface.ROAD, id="a lane for buses and bicycles"),
        pytest.param('allow="bicycle scooter"', Surface.CYCLEWAY, id="a cycleway"),
        pytest.param('allow="tram bicycle"', Surface.CYCLEWAY, id="a cycleway on a tramway"),
        pytest.param('allow="tram"', Surface.TRACK, id="a tramway"),
        pytest.param('allow="rail rail_urban"', Surface.TRACK, id="a railway"),
    ],
)
def test_lanes_without_cars_are_painted_for_what_may_go_there(allow: str, surface: Surface) -> None:
    nodes = "".join(f'<node id="{end}{y}" x="{x}" y="{y}"/>' for y in (0, 40) for end, x in (("w", 0), ("e", 100)))
    other = f'<edge id="other" from="w40" to="e40" numLanes="1" speed="9" width="{LANE_M}" {allow}/>'
    ground = ground_of(_build("other_lanes", nodes, _road("w0", "e0") + other))
    assert rasterise(ground, 50.0, 40.0 - LANE_M / 2, 1, 0.02, 0.0)[0, 0] == surface


# Buildings, lights, signs, bodies


@pytest.mark.parametrize("name", ["town-train", "ingolstadt"])
def test_buildings_stand_beside_roads_and_not_in_each_other(name: str) -> None:
    network = load_network(name)
    x0, y0, x1, y1 = network.bounds
    rows = buildings_near(network, (x0 + x1) / 2, (y0 + y1) / 2, 250.0)
    assert len(rows) > 20
    shapes = shapely.polygons(buildings._corners(rows, 0.0))
    assert not shapely.intersects(shapes, network.drivable_area).any()
    pairs = shapely.STRtree(shapes).query(shapes, predicate="intersects")
    assert (pairs[0] == pairs[1]).all()
    assert shapely.distance(shapes, network.drivable_area).min() > 1.0
    assert (rows[:, 5] > 5.0).all()


def test_which_buildings_stand_does_not_depend_on_where_one_comes_from() -> None:
    network = load_network("town-train")
    there = buildings_near(network, 400.0, 250.0, 100.0)
    buildings._block.cache_clear()
    for x in np.arange(0.0, 400.0, 50.0):
        buildings_near(network, x, 250.0, 100.0)
    np.testing.assert_array_equal(buildings_near(network, 400.0, 250.0, 100.0), there)


def test_every_signal_hangs_over_its_lane() -> None:
    network = lit_crossing().network
    fixtures = fixtures_of(network)
    driven = network.lanes.drivable[network.connections.source] & (network.connections.signal >= 0)
    assert set(fixtures.signal.tolist()) == set(network.connections.signal[driven].tolist())
    east = fixtures.heads[np.abs(fixtures.heads[:, 2]) < 0.1]
    assert east[:, 0] == pytest.approx(lit_crossing().stop_line("w_c_0") + 8.0)
    assert (east[:, 1] < 0.0).all()
    assert len(fixtures.wires) == 4


def test_stop_signs_stand_where_one_must_stop() -> None:
    signs = fixtures_of(stop_sign_crossing().network).signs
    assert sorted(np.round(np.cos(signs[:, 2]))) == [-1.0, 1.0]
    eastward = signs[np.cos(signs[:, 2]) > 0][0]
    assert eastward[1] == pytest.approx(-6.4 - 0.7)


def test_every_body_stays_in_its_box_but_for_patches_of_a_centimetre() -> None:
    assert np.abs(PARTS[:, [0, 1, 2, 3, 6, 7]]).max() < 1.01
    for kind in ActorKind:
        parts = PARTS[PARTS_START[kind] : PARTS_START[kind + 1]]
        assert parts[:, 4].min() < 0.4
        assert parts[:, 5].max() == HEIGHT_M[kind]


def test_an_actor_keeps_its_colour() -> None:
    kind, key = np.repeat(np.arange(9), 50), np.tile(np.arange(50), 9)
    colours = own_colours(kind, key)
    assert colours.shape == (450, 3)
    np.testing.assert_array_equal(own_colours(kind[::-1], key[::-1]), colours[::-1])
    assert len(np.unique(colours[kind == ActorKind.CAR], axis=0)) > 5
