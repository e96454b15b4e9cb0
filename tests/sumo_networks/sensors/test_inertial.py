"""IMU, GNSS, radar, route map and the projection: hand computations, and what the errors are made of."""

from __future__ import annotations

import dataclasses
import gzip
import math
import re
from collections.abc import Sequence
from pathlib import Path

import libsumo
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dohyo.sumo_networks.conditions import CONDITIONS, Conditions
from dohyo.sumo_networks.ego.dynamics import GRAVITY, HEADING, SPEED, VehicleParameters, Vehicles
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.geometry import ray_to_box
from dohyo.sumo_networks.networks.catalog import load_network
from dohyo.sumo_networks.networks.projection import Projection, enu_to_geodetic, geodetic_to_enu, read_projection
from dohyo.sumo_networks.sensors import CameraConfig, make_sensors
from dohyo.sumo_networks.sensors.gnss import L80, RTK, Gnss, GnssErrors, GnssNoise
from dohyo.sumo_networks.sensors.imu import ICM_20600, Imu, ImuErrors, ImuNoise, specific_force_and_rate
from dohyo.sumo_networks.sensors.radar import ANGLES, Radar
from dohyo.sumo_networks.world import ActorKind, World
from tests.worlds import Scene, straight_road

PERFECT = ImuNoise()
CAR = VehicleParameters()


def rng() -> np.random.Generator:
    return np.random.default_rng(0)


def moving(world: World, vehicles: Vehicles) -> World:
    """The world, with the egos' motion taken from vehicles."""
    egos = dataclasses.replace(
        world.egos, motion=vehicles.motion, speed=vehicles.states[:, SPEED].copy(), position=vehicles.centres()
    )
    return dataclasses.replace(world, egos=egos)


# IMU


def test_at_rest_the_imu_feels_gravity_alone() -> None:
    world = straight_road().with_ego(x=100.0).world()
    reading = Imu(rng(), PERFECT).read(world, 0)
    np.testing.assert_allclose(reading, np.tile([0, 0, GRAVITY, 0, 0, 0], (10, 1)), atol=1e-6)


def test_a_steady_turn_pulls_to_the_side_by_v_squared_over_r() -> None:
    speed, radius = 8.0, 20.0
    n = np.ones(10)
    rear = specific_force_and_rate(speed * n, 0 * n, speed / radius * n, 0 * n, mounting=(0.0, 0.0))
    np.testing.assert_allclose(rear, np.tile([0, speed**2 / radius, GRAVITY, 0, 0, speed / radius], (10, 1)))
    # 1.35 m ahead of the rear axle the body also turns around it: w^2 r towards the axle.
    centre = specific_force_and_rate(speed * n, 0 * n, speed / radius * n, 0 * n, mounting=(1.35, 0.0))
    np.testing.assert_allclose(centre[:, 0], -((speed / radius) ** 2) * 1.35)
    np.testing.assert_allclose(centre[:, 1], speed**2 / radius)


def test_mounted_to_the_left_a_growing_yaw_rate_pulls_backwards() -> None:
    n = np.ones(1)
    out = specific_force_and_rate(0 * n, 0 * n, 0 * n, 2.0 * n, mounting=(0.0, 0.5))
    np.testing.assert_allclose(out[0, :2], [-1.0, 0.0])


def test_the_imu_integrates_back_to_the_vehicles_motion() -> None:
    vehicles, world = Vehicles(CAR, 1), straight_road().with_ego(x=100.0).world()
    vehicles.place(0, 0.0, 0.0, 0.0)
    imu, random = Imu(rng(), PERFECT, mounting=(0.0, 0.0)), np.random.default_rng(1)
    imu.read(world, 0)
    heading, velocity, position = 0.0, np.zeros(2), vehicles.states[0, :2].copy()
    for tick in range(200):
        vehicles.advance(np.array([[2.0 if tick < 60 else random.uniform(-1.0, 1.0), random.uniform(-0.1, 0.1)]]), 0.1)
        for force_x, force_y, _, _, _, rate in imu.read(moving(world, vehicles), 0).astype(np.float64):
            middle = heading + 0.005 * rate
            turn = np.array([[math.cos(middle), -math.sin(middle)], [math.sin(middle), math.cos(middle)]])
            velocity, heading = velocity + 0.01 * turn @ [force_x, force_y], heading + 0.01 * rate
            position = position + 0.01 * velocity
    state = vehicles.states[0]
    assert state[SPEED] > 4.0
    assert math.remainder(heading - state[HEADING], 2 * math.pi) == pytest.approx(0.0, abs=1e-4)
    np.testing.assert_allclose(np.hypot(*velocity), state[SPEED], atol=0.05)
    np.testing.assert_allclose(position, state[:2], atol=0.5)


def test_the_first_sample_of_a_tick_knows_the_last_yaw_rate_of_the_one_before() -> None:
    world = straight_road().with_ego(x=100.0, speed=0.0).world()
    motion = np.zeros((1, 10, 2))
    motion[0, :, 1] = 0.3
    steady = dataclasses.replace(world, egos=dataclasses.replace(world.egos, motion=motion))
    imu = Imu(rng(), PERFECT, mounting=(1.0, 0.0))
    assert imu.read(steady, 0)[0, 1] == pytest.approx(30.0, rel=1e-5)  # from 0 to 0.3 rad/s in 0.01 s, 1 m away
    assert imu.read(steady, 0)[0, 1] == pytest.approx(0.0, abs=1e-5)


def test_noise_has_the_data_sheets_densities_and_the_offsets_of_the_table() -> None:
    quiet = dataclasses.replace(
        ICM_20600, accelerometer_walk=0.0, gyroscope_walk=0.0, accelerometer_spread=0.0, gyroscope_spread=0.0
    )
    out = ImuErrors(quiet, rng()).corrupt(np.zeros((100_000, 6)))
    np.testing.assert_allclose(out.mean(axis=0)[:3], [0.266818, 0.180452, -0.089558], atol=2e-4)
    np.testing.assert_allclose(np.degrees(out.mean(axis=0)[3:]), [-1.237829, -2.018467, -0.798545], atol=1e-3)
    np.testing.assert_allclose(out.std(axis=0)[:3], 100e-6 * GRAVITY * 10, rtol=0.02)  # density times root of 100 Hz
    np.testing.assert_allclose(np.degrees(out.std(axis=0)[3:]), 0.04, rtol=0.02)


def test_an_offset_walks_with_the_root_of_time_and_goes_on_where_it_was() -> None:
    noise = ImuNoise(accelerometer_walk=0.1)
    ends = []
    for seed in range(300):
        errors = ImuErrors(noise, np.random.default_rng(seed))
        first = errors.corrupt(np.zeros((50, 6)))
        second = errors.corrupt(np.zeros((50, 6)))
        assert np.abs(second[0, 0] - first[-1, 0]) < 0.1
        ends.append(second[-1, :3])
    assert np.std(ends) == pytest.approx(0.1, rel=0.1)  # after 1 s


def test_vibration_shakes_a_moving_vehicle_only() -> None:
    errors = ImuErrors(ImuNoise(vibration=0.5), rng())
    assert np.abs(errors.corrupt(np.zeros((100, 6)), moving=False)).max() == 0.0
    shaken = errors.corrupt(np.zeros((5000, 6)), moving=True)
    assert shaken[:, :3].std() == pytest.approx(0.5, rel=0.05)
    assert np.abs(shaken[:, 3:]).max() == 0.0


def test_neither_other_sensors_nor_their_order_change_a_sensors_noise() -> None:
    world = straight_road().with_ego(x=100.0).with_actor(120.0, 3.0).world()
    camera = CameraConfig(name="camera", width=16, height=16)
    noisy = ("detections", "radar", "gnss", "gnss_rtk", "imu", camera)

    def readings(names: Sequence[str | CameraConfig]) -> dict[str, np.ndarray]:
        sensors = make_sensors(names, conditions=CONDITIONS["heavy-rain"], rng=rng())
        ticks = [{sensor.name: sensor.read(world, 0) for sensor in sensors} for _ in range(3)]
        return {name: np.stack([tick[name] for tick in ticks]) for name in ticks[0]}

    together = readings(noisy)
    for chosen in (noisy[::-1], *((one,) for one in noisy)):
        for name, reading in readings(chosen).items():
            np.testing.assert_array_equal(reading, together[name], err_msg=name)
    # Sensors of one kind with different names have errors of their own.
    twin = readings([camera, camera.model_copy(update={"name": "twin"})])
    assert (twin["camera"] != twin["twin"]).any()


# GNSS


def test_gnss_error_has_the_sigma_asked_for_and_the_correlation() -> None:
    errors, n = GnssErrors(GnssNoise(2.0, correlated_share=0.5, correlation_s=5.0), rng()), 80_000
    series = np.array([errors.corrupt(np.zeros(3), 0.1) for _ in range(n)])
    np.testing.assert_allclose(series.std(axis=0), [2.0, 2.0, 3.0], rtol=0.06)
    x = series[:, 0]
    lagged = float(np.mean(x[:-50] * x[50:]) / np.mean(x * x))  # 5 s later
    assert lagged == pytest.approx(0.5 * math.exp(-1.0), abs=0.06)


def test_fixes_come_at_their_rate_and_dropouts_are_missing() -> None:
    worlds = straight_road().with_ego(x=100.0).worlds(seconds=40.0)
    slow = Gnss(rng(), GnssNoise(1.0, rate_hz=0.2))
    assert [world.tick for world in worlds if slow.read(world, 0)[0]] == [0, 50, 100, 150, 200, 250, 300, 350, 400]
    patchy = Gnss(rng(), GnssNoise(1.0, dropout=0.3))
    seen = [bool(patchy.read(world, 0)[0]) for world in worlds]
    assert np.mean(seen) == pytest.approx(0.7, abs=0.1)


def test_latitude_and_longitude_are_those_of_the_position() -> None:
    world = dataclasses.replace(straight_road().with_ego(x=100.0).world(), network=load_network("ingolstadt"))
    egos = dataclasses.replace(world.egos, position=np.array([[5700.0, 5650.0]]))
    reading = Gnss(rng(), GnssNoise(1e-6)).read(dataclasses.replace(world, egos=egos), 0).astype(np.float64)
    assert reading[0] == 1.0
    np.testing.assert_allclose(reading[1:3], [5700.0, 5650.0], atol=1e-3)
    latitude, longitude = reading[4] + reading[5] / 60, reading[6] + reading[7] / 60
    assert reading[8] == 1.0
    assert (latitude, longitude) == pytest.approx((48.77, 11.42), abs=0.03)
    projection = read_projection(load_network("ingolstadt").path)
    np.testing.assert_allclose(projection.from_wgs84(latitude, longitude), [5700.0, 5650.0], atol=0.02)


def test_without_a_projection_the_receiver_says_so() -> None:
    reading = Gnss(rng(), L80).read(straight_road().with_ego(x=100.0).world(), 0)
    assert reading[8] == 0.0
    assert abs(reading[4]) == 0.0


def placed(path: Path, projection: str) -> Path:
    """A net with another projection than its own; coordinates stay."""
    told = f'projParameter="{projection}"'.encode()
    path.write_bytes(re.sub(rb'projParameter="[^"]*"', told, load_network("braunschweig").path.read_bytes(), count=1))
    return path


def check_against_sumo(path: Path, back_m: float = 2e-3) -> None:
    """Degrees of three points as libsumo has them, and back; another datum loses some centimetres with the height."""
    projection = read_projection(path)
    libsumo.start(["sumo", "-n", str(path), "--no-step-log", "true", "--no-warnings", "true"])
    try:
        for x, y in ((0.0, 0.0), (5700.0, 5650.0), (2500.0, 3000.0)):
            longitude, latitude = libsumo.simulation.convertGeo(x, y)
            back = projection.from_wgs84(latitude, longitude)
            np.testing.assert_allclose(back, [x, y], atol=back_m)
            np.testing.assert_allclose(projection.to_wgs84(x, y), [latitude, longitude], atol=2e-8)
    finally:
        libsumo.close()


@pytest.mark.parametrize("name", ["ingolstadt", "adlershof"])
def test_the_projection_agrees_with_sumos(name: str) -> None:
    check_against_sumo(load_network(name).path)


@pytest.mark.parametrize(
    "projection",
    [
        "+proj=tmerc +lat_0=52 +lon_0=10 +k=1 +x_0=500000 +y_0=0 +datum=WGS84 +units=m  +vunits=m +no_defs",
        "+proj=tmerc +lat_0=52 +lon_0=9 +k=1 +x_0=0 +y_0=0 +ellps=bessel +towgs84=598.1,73.7,418.2 +units=m",
        "+proj=merc +a=6378137 +b=6378137 +lat_ts=0 +lon_0=0 +units=m +nadgrids=@null +wktext +no_defs",
        "+proj=utm +zone=33 +ellps=GRS80 +units=m +type=crs",
    ],
)
def test_other_projections_than_utm_agree_with_sumos(tmp_path: Path, projection: str) -> None:
    check_against_sumo(placed(tmp_path / "x.net.xml", projection), back_m=0.2 if "towgs84" in projection else 2e-3)


def test_a_net_that_gets_another_projection_is_read_again(tmp_path: Path) -> None:
    net = placed(tmp_path / "x.net.xml", "+proj=utm +zone=33")
    first = read_projection(net).to_wgs84(0.0, 0.0)
    assert read_projection(placed(net, "+proj=utm +zone=10")).to_wgs84(0.0, 0.0)[1] < first[1] - 90.0


UTM = '<location netOffset="-300000.00,-5000000.00" convBoundary="0,0,1,1" projParameter="+proj=utm +zone=33 +south"/>'


@pytest.mark.parametrize(
    "text",
    [
        UTM,
        UTM.replace("-5000000.00", "-5e6"),
        UTM.replace('"', "'"),
        UTM.replace("+proj=utm +zone=33 +south", "+south +zone=33 +ellps=WGS84 +proj=utm"),
        '<location projParameter="+proj=utm +zone=33 +south" netOffset="-300000.00,-5000000.00"/>',
        "<location\n  netOffset = '-3e5,-5e6'\n  projParameter = '+proj=utm +zone=33 +south'></location>",
        f"<!-- {'x' * 70_000} -->{UTM}",
    ],
)
def test_the_location_of_a_net_is_read_in_each_of_its_spellings(tmp_path: Path, text: str) -> None:
    net, packed = tmp_path / "x.net.xml", tmp_path / "x.net.xml.gz"
    net.write_text(f"<net>{text}</net>")
    packed.write_bytes(gzip.compress(net.read_bytes()))
    found, same = read_projection(net), read_projection(packed)
    assert found == same
    assert found.offset == (-300_000.0, -5_000_000.0)
    latitude, longitude = found.to_wgs84(200_000.0, 4_000_000.0)
    assert (latitude, longitude) == pytest.approx((-9.0, 15.0), abs=0.1)  # 1,000 km south of the equator, mid-zone


def test_nets_without_a_place_have_a_local_origin_and_broken_ones_are_refused(tmp_path: Path) -> None:
    net = tmp_path / "x.net.xml"
    net.write_text("<net></net>")
    assert read_projection(net) == Projection()
    for number, text in enumerate(
        [f"<net>{UTM.replace('-300000.00', 'west')}</net>", f"<net>{UTM.replace('utm', 'utn')}</net>", "<a></b>"]
    ):
        broken = tmp_path / f"{number}.net.xml"
        broken.write_text(text)
        with pytest.raises(InvalidInputError, match="cannot read the location of network file"):
            read_projection(broken)


@given(
    st.floats(-80, 80),
    st.floats(-179, 179),
    st.floats(-100, 3000),
    st.tuples(*[st.floats(-5000, 5000)] * 2, st.floats(-90, 90)),
)
def test_east_north_up_and_back(lat: float, lon: float, height: float, point: tuple[float, float, float]) -> None:
    origin = (lat, lon, height)
    there = enu_to_geodetic(np.array(point), origin)
    np.testing.assert_allclose(geodetic_to_enu(np.array([there]), origin)[0], point, atol=1e-4)


def test_a_degree_of_latitude_is_111_km() -> None:
    east, north, up = geodetic_to_enu(np.array([[46.0, 7.0, 0.0]]), (45.0, 7.0, 0.0))[0]
    assert (east, north) == pytest.approx((0.0, 111_130), abs=40)
    assert up == pytest.approx(-970, abs=20)  # the ground falls away


# Radar


def radar_of(scene: Scene, conditions: Conditions | None = None) -> np.ndarray:
    sensor = Radar(conditions or Conditions(), rng())
    out = sensor.read(scene.world(), 0)
    assert sensor.space.contains(out)
    return out


def test_nothing_ahead_is_nothing_met() -> None:
    out = radar_of(straight_road().with_ego(x=100.0, speed=5.0).with_actor(80.0))
    np.testing.assert_array_equal(out, np.tile(np.array([80, -1, 0], np.float32), (9, 1)))


def test_the_middle_ray_meets_the_car_ahead() -> None:
    out = radar_of(straight_road().with_ego(x=100.0, speed=10.0).with_actor(130.0, 4.0))
    assert out[4] == pytest.approx([30.0 - 4.5, ActorKind.CAR, -6.0])  # bumper to bumper, coming nearer at 6 m/s
    assert (out[[0, 1, 2, 3, 5, 6, 7, 8], 1] == -1).all()


def test_a_ray_at_an_angle_meets_a_side_and_feels_the_speed_along_it_only() -> None:
    # A wall 5 m to the left, along the road: the ray at 30 degrees meets it after 5 / sin 30 = 10 m.
    scene = straight_road().with_ego(x=100.0, speed=8.0)
    scene = scene.with_actor(110.0, left=5.5, length=60.0, width=1.0, kind=ActorKind.STATIC)
    out = radar_of(scene)
    assert np.degrees(ANGLES[2]) == pytest.approx(30.0)
    assert out[2] == pytest.approx([10.0, ActorKind.STATIC, -8.0 * math.cos(math.radians(30.0))], abs=1e-4)
    assert out[0, 0] == pytest.approx(5.0 / math.sin(math.radians(60.0)), abs=1e-4)
    assert (out[4:, 1] == -1).all()


def test_the_nearer_body_hides_the_other_and_80_m_is_the_end() -> None:
    scene = straight_road().with_ego(x=100.0).with_actor(140.0, kind=ActorKind.BUS).with_pedestrian(120.0, y=-4.8)
    assert radar_of(scene)[4, 1] == ActorKind.PEDESTRIAN
    assert radar_of(straight_road().with_ego(x=100.0).with_actor(185.0))[4, 1] == -1
    assert radar_of(straight_road().with_ego(x=100.0).with_ego(x=150.0, speed=3.0))[4, 1] == ActorKind.EGO


def test_conditions_disturb_what_is_met() -> None:
    scene = straight_road().with_ego(x=100.0, speed=10.0).with_actor(150.0)
    sensor, world = Radar(CONDITIONS["heavy-rain"], rng()), scene.world()
    rays = np.array([sensor.read(world, 0)[4] for _ in range(1000)])
    met = rays[:, 1] >= 0
    assert np.mean(~met) == pytest.approx(0.08, abs=0.04)
    assert rays[met, 0].std() == pytest.approx(0.4 * 45.5 / 20.0, rel=0.15)
    assert rays[met, 2].std() == pytest.approx(0.8, rel=0.15)


@given(st.floats(-50, 50), st.floats(-50, 50), st.floats(-3.1, 3.1), st.floats(-3.1, 3.1))
def test_a_ray_ends_on_the_edge_of_its_box(x: float, y: float, towards: float, turned: float) -> None:
    box = np.array([3.0, -2.0, turned, 4.5, 1.8])
    distance = ray_to_box(x, y, math.cos(towards), math.sin(towards), box)
    dx, dy = x + distance * math.cos(towards) - 3.0, y + distance * math.sin(towards) + 2.0
    if math.isinf(distance):
        return
    along, across = (
        abs(dx * math.cos(turned) + dy * math.sin(turned)),
        abs(dy * math.cos(turned) - dx * math.sin(turned)),
    )
    assert along <= 2.25 + 1e-6
    assert across <= 0.9 + 1e-6
    assert distance == 0.0 or along == pytest.approx(2.25, abs=1e-6) or across == pytest.approx(0.9, abs=1e-6)


def test_a_ray_to_the_middle_of_a_box_never_misses() -> None:
    random = np.random.default_rng(2)
    for _ in range(200):
        x, y, turned = random.uniform(-30, 30), random.uniform(-30, 30), random.uniform(-3, 3)
        length = math.hypot(x, y)
        assert ray_to_box(x, y, -x / length, -y / length, np.array([0.0, 0.0, turned, 4.0, 2.0])) <= length


# Route map


def test_the_route_map_holds_the_route_around_the_ego_in_the_networks_frame() -> None:
    scene = straight_road().with_ego(x=430.0, left=1.0)
    world = scene.world()
    (sensor,) = make_sensors(["route_map"])
    page = sensor.read(world, 0)
    assert sensor.space.contains(page)
    progress = float(world.egos.progress[0])
    assert 50.0 <= progress - page[0, 7] < 100.0
    assert page[0, 7] % 50.0 == pytest.approx(0.0, abs=1.0)
    np.testing.assert_allclose(np.diff(page[:, 0]), 1.0, atol=1e-2)
    np.testing.assert_allclose(page[:, 1], -4.8, atol=1e-3)


def test_the_route_map_does_not_tell_where_on_the_page_one_is() -> None:
    (sensor,) = make_sensors(["route_map"])
    pages = [sensor.read(straight_road().with_ego(x=x, left=left).world(), 0) for x, left in ((430, 0), (447, -1.5))]
    np.testing.assert_array_equal(*pages)


@pytest.mark.parametrize("rate", [20.0, 7.0, 4.0, 0.0, -1.0])
def test_a_receiver_whose_fixes_are_no_whole_ticks_apart_is_refused(rate: float) -> None:
    with pytest.raises(InvalidInputError, match="rate_hz: expected 10, 5, 2 or another whole part"):
        GnssNoise(sigma_m=1.0, rate_hz=rate)
    assert GnssNoise(sigma_m=1.0, rate_hz=2.5).rate_hz == 2.5


def test_two_receivers_without_a_generator_have_errors_of_their_own() -> None:
    world = straight_road().with_ego(x=100.0).world()
    wrong = [one.read(world, 0)[1:3] - world.egos.position[0] for one in make_sensors(["gnss", "gnss_rtk"])]
    assert not np.allclose(wrong[0] / L80.sigma_m, wrong[1] / RTK.sigma_m, rtol=0.2)
