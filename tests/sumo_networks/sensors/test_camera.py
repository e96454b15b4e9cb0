from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from dohyo.sumo_networks.conditions import CONDITIONS
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.rendering.labels import Label
from dohyo.sumo_networks.routes.routing import plan_route
from dohyo.sumo_networks.scenario import Mission, Place
from dohyo.sumo_networks.sensors import CameraConfig, Track, make_sensors
from dohyo.sumo_networks.units import SIGHT_M
from dohyo.sumo_networks.world import ActorKind, LightState, World
from tests.worlds import Scene, crossing_for_pedestrians, lit_crossing, stop_sign_crossing, straight_road

MODES = ("rgb", "semantic", "depth")
FOCAL = 128.0  # of 256 px over 90 degrees
X, Z = 1.3, 1.8  # where the camera is mounted by default


def shot(world: World, mode: str = "rgb", conditions: str = "clear", seed: int = 0, **options: object) -> np.ndarray:
    config = CameraConfig(name="camera", mode=mode, **options)  # type: ignore[arg-type]
    (camera,) = make_sensors([config], Track.SENSORS, CONDITIONS[conditions], np.random.default_rng(seed))
    picture = camera.read(world, 0)
    assert config.space.contains(picture)
    return picture


def all_modes(world: World, **options: object) -> list[np.ndarray]:
    return [shot(world, mode, **options) for mode in MODES]  # type: ignore[arg-type]


def same(a: list[np.ndarray], b: list[np.ndarray]) -> bool:
    return all(np.array_equal(one, other) for one, other in zip(a, b, strict=True))


def extent(mask: np.ndarray) -> tuple[int, int, int, int]:
    """First and last row, first and last column."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    return int(rows[0]), int(rows[-1]), int(columns[0]), int(columns[-1])


def road() -> Scene:
    return straight_road().with_ego(x=300.0)


def busy() -> Scene:
    scene = crossing_for_pedestrians().with_ego(x=-45.0, left=0.6, heading=0.15, speed=7.0)
    scene = scene.with_actor(4.8, 8.0, y=-50.0, heading=math.pi / 2).with_actor(-20.0, 3.0).with_actor(-72.0, 9.0)
    scene = scene.with_actor(40.0, 6.0, y=4.8, heading=math.pi).with_pedestrian(-8.4, 1.4, y=3.0, heading=-math.pi / 2)
    return scene.with_lights(LightState.RED, s=LightState.GREEN)


# Where things are in the picture


@pytest.mark.parametrize(("ahead", "left"), [(10.0, 0.0), (10.0, 2.0), (25.0, -3.0), (4.0, 0.5)])
def test_a_box_covers_the_pixels_that_its_corners_project_to(ahead: float, left: float) -> None:
    world = road().with_actor(
        300.0 + X + ahead + 1.0, kind=ActorKind.STATIC, left=left, length=2.0, width=2.0
    )  # 1 m high, its near side `ahead` of the camera
    rows, last_row, columns, last_column = extent(shot(world.world(), "semantic")[0] == Label.OBSTACLE)
    depths = np.array([ahead, ahead + 2.0])
    u = 128.0 - FOCAL * np.add.outer([left - 1.0, left + 1.0], np.zeros(2)) / depths
    assert columns == pytest.approx(max(u.min(), 0.0), abs=1.0)
    assert last_column + 1 == pytest.approx(min(u.max(), 256.0), abs=1.0)
    assert last_row + 1 == pytest.approx(min(128.0 + FOCAL * Z / ahead, 256.0), abs=1.0)
    assert rows == pytest.approx(128.0 + FOCAL * (Z - 1.0) / (ahead + 2.0), abs=1.0)


def test_a_car_ten_metres_ahead_is_as_wide_and_high_as_it_should_be() -> None:
    world = road().with_actor(300.0 + X + 10.0 + 2.3, length=4.6, width=1.8).world()
    top, bottom, left, right = extent(shot(world, "semantic")[0] == Label.VEHICLE)
    assert (left, right + 1) == pytest.approx((128 - FOCAL * 0.09, 128 + FOCAL * 0.09), abs=1.0)
    # The roof is 1.48 m high and begins 0.8 m before the rear bumper; the body begins 0.3 m above the road.
    assert top == pytest.approx(128 + FOCAL * (Z - 1.48) / 10.8, abs=1.0)
    assert 128 + FOCAL * (Z - 0.3) / 10.0 <= bottom + 2 <= 128 + FOCAL * Z / 10.0 + 2


def test_depth_is_what_geometry_says() -> None:
    world = road().with_actor(300.0 + X + 10.0 + 1.0, kind=ActorKind.STATIC, length=2.0, width=2.0).world()
    depth, labels = shot(world, "depth")[0], shot(world, "semantic")[0]
    assert depth[145, 120:137] == pytest.approx(10.0, rel=0.01)
    assert depth[137, 128] == pytest.approx((Z - 1.0) * FOCAL / (137.5 - 128.0), rel=0.01)  # its top
    rows = np.arange(160, 256)
    assert depth[160:, 128] == pytest.approx(Z * FOCAL / (rows + 0.5 - 128.0), rel=0.01)
    assert (depth[labels == Label.NONE] == 1000.0).all()
    assert (depth[labels != Label.NONE] <= 100.0).all()


@given(st.floats(-170, 170), st.floats(-30, 30), st.floats(-40, 40), st.floats(0.5, 4.0))
def test_the_ground_lies_where_the_rays_of_a_camera_meet_it(yaw: float, pitch: float, roll: float, z: float) -> None:
    options = {"width": 32, "height": 24, "yaw_deg": yaw, "pitch_deg": pitch, "roll_deg": roll, "z_m": z}
    world = straight_road().with_ego(x=500.0, y=-400.0).world()  # far from everything
    depth = shot(world, "depth", **options)[0]
    focal = 16.0
    y, p, r = (math.radians(angle) for angle in (yaw, pitch, roll))
    turn = np.array([[math.cos(y), -math.sin(y), 0], [math.sin(y), math.cos(y), 0], [0, 0, 1]])
    lift = np.array([[math.cos(p), 0, -math.sin(p)], [0, 1, 0], [math.sin(p), 0, math.cos(p)]])
    lean = np.array([[1, 0, 0], [0, math.cos(r), -math.sin(r)], [0, math.sin(r), math.cos(r)]])
    for row, column in ((2, 3), (12, 16), (22, 5), (23, 31)):
        ray = turn @ lift @ lean @ [1.0, (16 - column - 0.5) / focal, (12 - row - 0.5) / focal]
        expected = z / -ray[2] if ray[2] < -1e-3 else math.inf
        if expected * np.linalg.norm(ray) < 99.0:
            assert depth[row, column] == pytest.approx(expected, rel=0.01)


def test_depth_and_labels_agree() -> None:
    world = busy().world()
    depth, labels = shot(world, "depth")[0], shot(world, "semantic")[0]
    np.testing.assert_array_equal(depth == 1000.0, labels == Label.NONE)
    bare = dataclasses.replace(world, actors=_none(world))
    nothing_there = shot(bare, "depth")[0]
    actors = np.isin(labels, (Label.VEHICLE, Label.PEDESTRIAN))
    assert actors.sum() > 50
    assert (depth[actors] < nothing_there[actors]).all()
    np.testing.assert_array_equal(depth[~actors], nothing_there[~actors])


def _none(world: World) -> object:
    fields = dataclasses.fields(world.actors)
    return dataclasses.replace(world.actors, **{one.name: getattr(world.actors, one.name)[:0] for one in fields})


# The near plane


def test_a_long_truck_beside_the_camera_is_cut_at_its_plane() -> None:
    world = road().with_actor(300.0 + X, kind=ActorKind.TRUCK, left=2.5, length=12.0, width=2.5).world()
    labels = shot(world, "semantic")[0]
    columns = np.flatnonzero(labels[128] == Label.VEHICLE)
    # Its right side is 1.25 m to the left, and ends 6 m ahead.
    assert columns[0] == 0
    assert columns[-1] + 1 == pytest.approx(128 - FOCAL * 1.25 / 6.0, abs=1.0)
    assert not (labels[:, 128:] == Label.VEHICLE).any()
    depth = shot(world, "depth")[0]
    for column in (0, 50, 90):
        assert depth[128, column] == pytest.approx(1.25 * FOCAL / (127.5 - column), rel=0.01)


def test_who_is_behind_is_not_seen() -> None:
    alone = all_modes(road().world())
    for ahead, left in ((-20.0, 0.0), (-8.0, 3.0), (-60.0, -10.0), (-3.4, 0.0)):
        assert same(all_modes(road().with_actor(300.0 + X + ahead, left=left).world()), alone), ahead


def test_a_camera_inside_a_box_draws_a_picture() -> None:
    world = road().with_actor(300.0 + X, kind=ActorKind.BUS, length=12.0, width=2.5).world()
    assert shot(world).shape == (3, 256, 256)


# What hides what, and what is no secret


def test_a_pedestrian_behind_a_van_changes_no_pixel() -> None:
    scene = road().with_actor(315.0, kind=ActorKind.VAN, length=6.2, width=2.1)
    hidden = [all_modes(scene.with_pedestrian(322.0 + shift, y=scene.route.position[0, 1]).world()) for shift in (0, 4)]
    assert same(hidden[0], all_modes(scene.world()))
    assert same(hidden[0], hidden[1])
    seen = all_modes(scene.with_pedestrian(322.0, y=scene.route.position[0, 1] + 5.0).world())
    assert not any(np.array_equal(a, b) for a, b in zip(seen, hidden[0], strict=True))


def test_order_of_actors_does_not_matter() -> None:
    world = road().with_actor(312.0, left=1.0).with_actor(330.0, kind=ActorKind.TRUCK).world()
    back = {one.name: getattr(world.actors, one.name)[::-1].copy() for one in dataclasses.fields(world.actors)}
    turned = dataclasses.replace(world, actors=dataclasses.replace(world.actors, **back))
    for mode in ("semantic", "depth"):
        np.testing.assert_array_equal(shot(turned, mode), shot(world, mode))


def test_the_route_is_not_in_the_picture() -> None:
    scene = lit_crossing().with_ego(x=-40.0)
    world = scene.world()
    other = plan_route(scene.network, Mission(start=Place(lane="w_c_1"), goal=Place(lane="c_n_1", position_m=-1.0)))
    elsewhere = dataclasses.replace(world, routes=(other,), egos=dataclasses.replace(world.egos, progress=np.zeros(1)))
    assert same(all_modes(world), all_modes(elsewhere))


def test_other_egos_are_seen_and_oneself_is_not() -> None:
    alone = shot(road().world(), "semantic")
    together = road().with_ego(x=320.0).world()
    assert (shot(together, "semantic") == Label.VEHICLE).any()
    assert not (alone == Label.VEHICLE).any()
    gone = dataclasses.replace(together, egos=dataclasses.replace(together.egos, active=np.array([True, False])))
    np.testing.assert_array_equal(shot(gone, "semantic"), alone)


# Turning


def test_a_turned_camera_sees_what_a_turned_ego_sees() -> None:
    options = {"x_m": 0.0, "mode": "semantic", "width": 160, "height": 80}
    scene = crossing_for_pedestrians().with_actor(10.0, y=20.0).with_pedestrian(-6.0, y=9.0)
    turned = shot(scene.with_ego(x=0.0, y=0.0, heading=math.pi / 2).world(), **options)  # type: ignore[arg-type]
    aside = shot(scene.with_ego(x=0.0, y=0.0).world(), yaw_deg=90.0, **options)  # type: ignore[arg-type]
    np.testing.assert_array_equal(turned, aside)


@pytest.mark.parametrize(("dx", "dy", "angle"), [(0.0, 0.0, math.pi / 2), (500.0, -300.0, 0.0), (-80.0, 2000.0, -2.5)])
def test_where_the_world_lies_on_the_map_is_nothing_to_a_camera(dx: float, dy: float, angle: float) -> None:
    here, there = busy().world(), busy().transformed(dx, dy, angle).world()
    for mode in MODES:
        a, b = shot(here, mode).astype(float), shot(there, mode).astype(float)
        # Texels lie otherwise on the ground: edges of markings may differ by a pixel.
        assert (np.abs(a - b).max(axis=0) > 24).mean() < 0.01, mode


# Lights, signs, colours


@pytest.mark.parametrize("state", LightState)
def test_a_light_shows_its_state(state: LightState) -> None:
    world = lit_crossing().with_ego(x=-35.0).with_lights(state).world()
    labels, picture = shot(world, "semantic")[0], shot(world)
    head = labels == Label.LIGHT_OFF + state
    assert head.sum() > 20
    others = {Label.LIGHT_OFF + other for other in LightState} - {Label.LIGHT_OFF + state}
    assert not np.isin(labels, list(others)).any()
    red, green, blue = (channel[head].astype(int) for channel in picture)
    shining = (np.maximum(red, green) > 200) & (blue < 150)
    assert shining.any() == (state is not LightState.OFF)
    if state is LightState.RED:
        assert (red[shining] > 2 * green[shining]).all()
    elif state is LightState.GREEN:
        assert (green[shining] > 2 * red[shining]).all()
    elif state is LightState.YELLOW:
        assert (green[shining] > 100).all()
        assert (red[shining] > 200).all()


def test_a_light_is_seen_from_its_stop_line_in_every_preset_that_looks_ahead() -> None:
    scene = lit_crossing().with_lights(LightState.RED)
    world = scene.with_ego(x=scene.stop_line("w_c_0") - 2.25 - 0.5).world()
    for size in ({"width": 256, "height": 256}, {"width": 160, "height": 80}, {"width": 256, "height": 144}):
        labels = shot(world, "semantic", fov_deg=70.0 if size["height"] == 144 else 90.0, **size)
        assert (labels == Label.LIGHT_RED).sum() > 10, size


def test_stop_signs_stand_to_the_right() -> None:
    labels = shot(stop_sign_crossing().with_ego(x=-25.0).world(), "semantic")[0]
    rows, _, columns, _ = extent(labels == Label.STOP_SIGN)
    assert columns > 128
    assert rows < 128
    assert not (shot(stop_sign_crossing().with_ego(x=-25.0, heading=math.pi).world(), "semantic") == 9).any()


@pytest.mark.parametrize("kind", [kind for kind in ActorKind if kind is not ActorKind.EGO])
def test_every_kind_has_its_label_and_is_in_every_picture(kind: ActorKind) -> None:
    expected = {
        ActorKind.BICYCLE: Label.BICYCLE,
        ActorKind.EMERGENCY: Label.EMERGENCY,
        ActorKind.PEDESTRIAN: Label.PEDESTRIAN,
        ActorKind.STATIC: Label.OBSTACLE,
    }.get(kind, Label.VEHICLE)
    world = road().with_actor(312.0, kind=kind).world()
    picture, labels, depth = all_modes(world)
    there = labels[0] == expected
    assert there.sum() > 30
    assert (picture[:, there] != shot(road().world())[:, there]).any(axis=0).mean() > 0.9
    assert (depth[0, there] < 16.0).all()


def test_an_indicator_shines() -> None:
    world = road().with_actor(312.0).world()
    blinking = dataclasses.replace(world, actors=dataclasses.replace(world.actors, indicator=np.array([1])))
    changed = (shot(world) != shot(blinking)).any(axis=0)
    assert changed.any()
    assert changed[:, :128].sum() == changed.sum()  # the left one, on the left


# Conditions


def test_conditions_change_the_picture_and_fog_hides() -> None:
    world = busy().world()
    pictures = {name: shot(world, conditions=name).astype(float) for name in CONDITIONS}
    for name, picture in pictures.items():
        others = [np.abs(picture - other).mean() for key, other in pictures.items() if key != name]
        assert min(others) > 3.0, name
    brightness = {name: picture.mean() for name, picture in pictures.items()}
    assert brightness["clear"] > brightness["wet"] > brightness["sunset"]


@pytest.mark.parametrize("conditions", CONDITIONS)
def test_nothing_beyond_the_visibility_is_seen(conditions: str) -> None:
    far = CONDITIONS[conditions].visibility_m + X
    alone = shot(road().world(), conditions=conditions)
    beyond = road().with_actor(300.0 + far + 4.0, kind=ActorKind.TRUCK, length=6.0, width=2.5).world()
    within = road().with_actor(300.0 + 0.6 * far, kind=ActorKind.TRUCK, length=6.0, width=2.5).world()
    np.testing.assert_array_equal(shot(beyond, conditions=conditions), alone)
    assert (shot(within, conditions=conditions) != alone).any()


def test_fog_grows_with_distance() -> None:
    def contrast(conditions: str, ahead: float) -> float:
        truck = {"kind": ActorKind.TRUCK, "length": 6.0, "width": 2.5}
        there, alone = road().with_actor(300.0 + ahead, **truck), road()  # type: ignore[arg-type]
        a, b = (shot(scene.world(), conditions=conditions).astype(float) for scene in (there, alone))
        visible = shot(there.world(), "semantic", conditions=conditions)[0] == Label.VEHICLE
        return float(np.abs(a - b)[:, visible].mean())

    near, far = ({name: contrast(name, ahead) for name in ("clear", "heavy-rain")} for ahead in (12.0, 45.0))
    assert far["heavy-rain"] / near["heavy-rain"] < 0.5 * far["clear"] / near["clear"]


@pytest.mark.parametrize("conditions", ["clear", "heavy-rain"])
def test_shadows_fade_with_distance_as_the_ground_does(conditions: str) -> None:
    def darkest(share: float) -> float:
        ahead = share * min(CONDITIONS[conditions].visibility_m, SIGHT_M)
        truck = road().with_actor(300.0 + X + ahead, kind=ActorKind.TRUCK, length=6.0, width=2.5).world()
        there, alone = (shot(world, "rgb", conditions, fov_deg=20.0) for world in (truck, road().world()))
        ground = shot(truck, "semantic", conditions, fov_deg=20.0)[0] != Label.VEHICLE
        return float((alone.astype(float) - there)[:, ground].max())

    assert darkest(0.35) > 10.0
    assert darkest(0.93) < 6.0


@pytest.mark.parametrize("kind", [ActorKind.BUS, ActorKind.TRUCK])
@pytest.mark.parametrize("x_m", [X, 8.0])
def test_a_long_body_is_seen_as_far_as_the_sight_reaches(kind: ActorKind, x_m: float) -> None:
    """Its centre is out of sight, its rear is not."""
    sight = CONDITIONS["heavy-rain"].visibility_m
    world = road().with_actor(300.0 + x_m + sight - 4.0 + 9.0, kind=kind, length=18.0, width=2.5).world()
    labels, depth = (shot(world, mode, "heavy-rain", x_m=x_m)[0] for mode in ("semantic", "depth"))
    seen = labels == Label.VEHICLE
    assert seen.any()
    assert depth[seen].min() == pytest.approx(sight - 4.0, abs=0.2)
    assert depth[seen].max() < sight


def test_noise_follows_from_the_seed_alone() -> None:
    world, other = busy().world(), busy().with_actor(-30.0, left=3.2).world()
    for name in CONDITIONS:
        np.testing.assert_array_equal(shot(world, conditions=name, seed=5), shot(world, conditions=name, seed=5))
    rain = [shot(world, conditions="heavy-rain", seed=seed) for seed in (5, 6)]
    assert (rain[0] != rain[1]).mean() > 0.3
    same_sky = shot(other, conditions="heavy-rain", seed=5)[:, :40]
    np.testing.assert_array_equal(same_sky, rain[0][:, :40])


def test_a_camera_does_not_touch_the_noise_of_other_sensors() -> None:
    world, conditions = busy().world(), CONDITIONS["heavy-rain"]
    (alone,) = make_sensors(["detections"], conditions=conditions, rng=np.random.default_rng(3))
    camera, beside = make_sensors(["camera_rgb", "detections"], conditions=conditions, rng=np.random.default_rng(3))
    camera.read(world, 0)
    np.testing.assert_array_equal(beside.read(world, 0), alone.read(world, 0))


def test_the_same_camera_draws_the_same_world_the_same_way_wherever_it_has_been() -> None:
    (camera,) = make_sensors(["camera_rgb"])
    scene = crossing_for_pedestrians()
    first = camera.read(scene.with_ego(x=-45.0).world(), 0)
    for x in (-160.0, -100.0, 60.0):
        camera.read(scene.with_ego(x=x).world(), 0)
    np.testing.assert_array_equal(camera.read(scene.with_ego(x=-45.0).world(), 0), first)


# Parameters and tracks


def test_a_camera_needs_no_privilege() -> None:
    assert all(sensor.track is Track.SENSORS for sensor in make_sensors(["camera_rgb", "camera_left"], Track.SENSORS))
    with pytest.raises(InvalidInputError, match="'birdseye' needs track 'privileged'"):
        make_sensors(["birdseye"], Track.MAP)


@pytest.mark.parametrize("wrong", [{"width": 4}, {"fov_deg": 180.0}, {"mode": "lidar"}, {"z_m": 0.0}, {"zoom": 2}])
def test_impossible_cameras_are_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        CameraConfig(name="camera", **wrong)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "options", [{"fov_deg": 90.0}, {"fov_deg": 10.0, "pitch_deg": -5.0}, {"pitch_deg": -80.0}, {"fov_deg": 150.0}]
)
def test_the_largest_pictures_find_room_for_their_tiles(options: dict[str, float]) -> None:
    world = crossing_for_pedestrians().with_ego(x=-20.0, heading=0.75).world()
    assert (shot(world, "semantic", width=2048, height=256, **options) == Label.ROAD).any()
