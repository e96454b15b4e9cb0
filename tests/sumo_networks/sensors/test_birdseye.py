from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
import shapely

from dohyo.sumo_networks.rendering.surfaces import LINE_M
from dohyo.sumo_networks.sensors import BirdseyeConfig, make_sensors
from dohyo.sumo_networks.sensors.birdseye import BACKGROUND, COLOURS, Layer
from dohyo.sumo_networks.world import ActorKind, LightState, World
from tests.worlds import Scene, crossing_for_pedestrians, lit_crossing, stop_sign_crossing, straight_road

PX_M = 0.25


def seen(world: World, ego: int = 0, **options: object) -> np.ndarray:
    config = BirdseyeConfig(name="birdseye", **options)  # type: ignore[arg-type]
    (birdseye,) = make_sensors([config])
    masks = birdseye.read(world, ego)
    assert config.space.contains(masks)
    return masks


def extent(mask: np.ndarray) -> tuple[int, int, int, int]:
    """First and last row, first and last column."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    return int(rows[0]), int(rows[-1]), int(columns[0]), int(columns[-1])


def road() -> Scene:
    return straight_road().with_ego(x=300.0)


def middles(config: BirdseyeConfig, world: World) -> np.ndarray:
    """(H, W, 2) where the middle of every pixel lies, m, network frame."""
    left = config.width * config.metres_per_px / 2
    rows, columns = np.mgrid[0 : config.height, 0 : config.width] + 0.5
    x, y = config.ahead_m - rows * config.metres_per_px, left - columns * config.metres_per_px
    heading = world.egos.heading[0]
    cos, sin = math.cos(heading), math.sin(heading)
    return np.stack([x * cos - y * sin, x * sin + y * cos], axis=-1) + world.egos.position[0]


@pytest.mark.parametrize("heading", [0.0, 0.4, -2.2])
@pytest.mark.parametrize("metres_per_px", [0.25, 0.5])
def test_the_road_is_what_a_slow_rasterisation_says_within_a_pixel(heading: float, metres_per_px: float) -> None:
    world = crossing_for_pedestrians().with_ego(x=-20.0, heading=heading).world()
    config = BirdseyeConfig(name="birdseye", metres_per_px=metres_per_px)
    mask = seen(world, metres_per_px=metres_per_px)[Layer.ROAD] == 255
    points = shapely.points(middles(config, world))
    network = world.network
    walking = [
        shapely.polygons(network.lane_shape(int(lane)))
        for lane in np.flatnonzero(network.lanes.pedestrian & ~network.lanes.crossing & ~network.lanes.drivable)
        if str(network.lanes.ids[lane]).startswith(":")
    ]
    lanes = [
        shapely.buffer(
            shapely.linestrings(network.lane_shape(int(lane))), network.lanes.width[lane] / 2, cap_style="flat"
        )
        for lane in np.flatnonzero(network.lanes.drivable | network.lanes.crossing)
    ]
    # Walking areas lie over the junction, lanes and crossings over both.
    area = shapely.union_all([shapely.difference(network.drivable_area, shapely.union_all(walking)), *lanes])
    area = shapely.buffer(area, 0.0)
    decided = shapely.distance(area.boundary, points) > metres_per_px
    assert decided.mean() > 0.8
    np.testing.assert_array_equal(mask[decided], shapely.contains(area, points)[decided])
    assert 0.1 < mask.mean() < 0.9


@pytest.mark.parametrize("heading", [0.0, 0.3])
def test_lines_lie_where_lanes_meet(heading: float) -> None:
    world = straight_road().with_ego(x=300.0, heading=heading).world()
    lines = seen(world)[Layer.LINES] == 255
    middle = middles(BirdseyeConfig(name="birdseye"), world)
    y = middle[..., 1][lines]
    off = np.abs(y[:, None] - [-3.2, 0.0, 3.2]).min(axis=1)
    assert off.max() < LINE_M / 2 + 1.5 * PX_M
    solid = np.abs(middle[..., 1]) < 0.05
    assert lines[solid].all()
    dashed = np.abs(np.abs(middle[..., 1]) - 3.2) < 0.05
    assert 0.25 < lines[dashed].mean() < 0.6


def test_boxes_are_where_they_are() -> None:
    masks = seen(road().with_actor(310.0, left=2.0, length=5.0, width=2.0).world())
    top, bottom, left, right = extent(masks[Layer.VEHICLES])
    assert (top, bottom + 1) == pytest.approx(((36 - 12.5) / PX_M, (36 - 7.5) / PX_M), abs=1)
    assert (left, right + 1) == pytest.approx((96 - 3.0 / PX_M, 96 - 1.0 / PX_M), abs=1)
    top, bottom, left, right = extent(masks[Layer.EGO])
    assert (top, bottom + 1) == pytest.approx(((36 - 2.25) / PX_M, (36 + 2.25) / PX_M), abs=1)
    assert (left + right + 1) / 2 == pytest.approx(96, abs=1)


def test_size_resolution_and_offset_are_parameters() -> None:
    options = {"width": 100, "height": 60, "metres_per_px": 0.5, "ahead_m": 10.0, "left_m": 5.0}
    masks = seen(road().with_actor(300.0, y=-30.0, length=4.0, width=2.0).world(), **options)
    assert masks.shape == (14, 60, 100)
    top, bottom, left, right = extent(masks[Layer.VEHICLES])
    assert (top, bottom + 1) == pytest.approx((16, 24), abs=1)
    y = 30.0 + road().world().egos.position[0, 1]
    assert (left, right + 1) == pytest.approx(((5 + y - 1) / 0.5, (5 + y + 1) / 0.5), abs=1)


@pytest.mark.parametrize(
    ("kind", "layer"),
    [
        (ActorKind.CAR, Layer.VEHICLES),
        (ActorKind.BUS, Layer.VEHICLES),
        (ActorKind.EMERGENCY, Layer.EMERGENCY),
        (ActorKind.BICYCLE, Layer.BICYCLES),
        (ActorKind.PEDESTRIAN, Layer.PEDESTRIANS),
        (ActorKind.STATIC, Layer.CONSTRUCTION),
    ],
)
def test_every_kind_has_its_layer(kind: ActorKind, layer: Layer) -> None:
    before, after = seen(road().world()), seen(road().with_actor(312.0, kind=kind).world())
    changed = [one for one in Layer if (before[one] != after[one]).any()]
    assert changed == [layer]


def test_other_egos_are_vehicles() -> None:
    world = road().with_ego(x=312.0).world()
    assert seen(world)[Layer.VEHICLES].any()
    assert seen(world, ego=1)[Layer.VEHICLES].any()


def test_people_are_drawn_larger_than_life() -> None:
    world = road().with_pedestrian(310.0, y=-4.0).world()
    views = [seen(world, pedestrian_scale=scale, metres_per_px=0.05, ahead_m=14.0) for scale in (1, 3)]
    areas = [np.count_nonzero(view[Layer.PEDESTRIANS]) for view in views]
    assert areas[0] * 0.05**2 == pytest.approx(0.3 * 0.5, rel=0.15)
    assert areas[1] / areas[0] == pytest.approx(9.0, rel=0.15)


def test_arrows_show_direction_and_speed() -> None:
    def arrow(speed: float) -> np.ndarray:
        return seen(road().with_actor(310.0, speed, left=2.0, heading=math.pi / 2).world())[Layer.ARROWS]

    assert not arrow(0.0).any()
    for speed in (8.0, 16.0):
        top, bottom, left, right = extent(arrow(speed))
        assert (right + 1 - left) * PX_M == pytest.approx(0.5 * speed, abs=2 * PX_M)
        assert (top + bottom + 1) / 2 == pytest.approx(26 / PX_M, abs=1)
        assert right + 1 == pytest.approx(96 - 2 / PX_M, abs=1)  # it starts in the middle, and points left


def test_the_route_lies_on_the_road_ahead() -> None:
    world = lit_crossing().with_ego(x=-40.0).world()
    masks = seen(world)
    top, bottom, left, right = extent(masks[Layer.ROUTE])
    assert (top, left, right + 1) == pytest.approx((0, 96 - 6, 96 + 6), abs=1)
    assert bottom + 1 == pytest.approx(36 / PX_M, abs=4)
    assert (masks[Layer.ROAD][masks[Layer.ROUTE] > 0] == 255).all()
    assert not seen(world, route_m=0.0)[Layer.ROUTE].any()


@pytest.mark.parametrize(
    ("state", "layer"),
    [
        (LightState.GREEN, Layer.GREEN_LIGHTS),
        (LightState.YELLOW, Layer.YELLOW_LIGHTS),
        (LightState.RED, Layer.RED_LIGHTS),
    ],
)
def test_the_routes_own_light_is_on_its_stop_line(state: LightState, layer: Layer) -> None:
    scene = lit_crossing()
    other = LightState.RED if state is LightState.GREEN else LightState.GREEN
    masks = seen(scene.with_ego(x=-30.0).with_lights(other, s=state).world())
    row = int((36.0 - (scene.stop_line("w_c_0") + 30.0)) / PX_M)
    found = {one for one in (Layer.GREEN_LIGHTS, Layer.YELLOW_LIGHTS, Layer.RED_LIGHTS) if masks[one, row, 96]}
    assert found == {layer}
    off = seen(scene.with_ego(x=-30.0).with_lights(LightState.OFF).world())
    assert not off[[Layer.GREEN_LIGHTS, Layer.YELLOW_LIGHTS, Layer.RED_LIGHTS]].any()


def test_stop_signs_have_their_layer() -> None:
    assert seen(stop_sign_crossing().with_ego(x=-30.0).world())[Layer.STOP_SIGNS].any()
    assert not seen(lit_crossing().with_ego(x=-30.0).world())[Layer.STOP_SIGNS].any()


def test_a_turned_ego_has_a_turned_view() -> None:
    scene = crossing_for_pedestrians().with_actor(12.0, 5.0, y=3.0, heading=0.7).with_pedestrian(-9.0, y=8.0)
    options = {"ahead_m": 24.0}
    straight = seen(scene.with_ego(x=0.0, y=0.0).world(), **options)
    turned = seen(scene.with_ego(x=0.0, y=0.0, heading=math.pi / 2).world(), **options)
    layers = [layer for layer in Layer if layer not in (Layer.EGO, Layer.ROUTE)]
    difference = turned[layers] != np.rot90(straight, k=-1, axes=(1, 2))[layers]
    assert difference.mean() < 0.001
    assert straight[layers].any(axis=(1, 2)).sum() >= 5


@pytest.mark.parametrize(("dx", "dy", "angle"), [(500.0, -300.0, 0.0), (0.0, 0.0, 1.0), (-80.0, 2000.0, -2.5)])
def test_where_the_world_lies_on_the_map_is_nothing_to_a_view(dx: float, dy: float, angle: float) -> None:
    scene = crossing_for_pedestrians().with_ego(x=-25.0, heading=0.2).with_actor(0.0, 4.0, left=3.0)
    here, there = seen(scene.world()), seen(scene.transformed(dx, dy, angle).world())
    assert (here != there).mean() < 0.004  # texels lie otherwise on the ground: edges move by up to a pixel


def test_the_picture_shows_the_topmost_layer() -> None:
    world = lit_crossing().with_ego(x=-30.0).with_actor(-12.0, 6.0).world()
    masks, picture = seen(world), seen(world, mode="rgb")
    expected = np.empty((192, 192, 3), dtype=np.uint8)
    expected[:] = BACKGROUND
    for layer in Layer:
        expected[masks[layer] == 255] = COLOURS[layer]
    np.testing.assert_array_equal(np.moveaxis(picture, 0, -1), expected)
    assert len({*COLOURS.values(), BACKGROUND}) == len(Layer) + 1


def test_masks_are_on_or_off_and_each_reading_is_a_new_array() -> None:
    (birdseye,) = make_sensors(["birdseye"])
    world = road().with_actor(310.0).world()
    first = birdseye.read(world, 0)
    kept = first.copy()
    second = birdseye.read(dataclasses.replace(world, egos=dataclasses.replace(world.egos, heading=np.array([0.5]))), 0)
    assert set(np.unique(first)) == {0, 255}
    np.testing.assert_array_equal(first, kept)
    assert (first != second).any()


@pytest.mark.parametrize("metres_per_px", [0.05, 2.0])
def test_the_largest_views_find_room_for_their_tiles(metres_per_px: float) -> None:
    world = crossing_for_pedestrians().with_ego(x=-20.0, heading=0.75).world()
    options = {"width": 2048, "height": 2048, "metres_per_px": metres_per_px}
    assert seen(world, mode="rgb", **options).any()


def test_a_sensor_outlives_the_tiles_of_its_resolution() -> None:
    """Seventeen other pools push out the one that it has read from."""
    world = road().world()
    (birdseye,) = make_sensors([BirdseyeConfig(name="birdseye")])
    before = birdseye.read(world, 0)
    for i in range(17):
        seen(world, metres_per_px=0.3 + 0.01 * i)
    assert np.array_equal(birdseye.read(world, 0), before)
