from __future__ import annotations

import dataclasses
import gzip
import io
import math
import re
from pathlib import Path

import numpy as np
import pytest
import shapely

from dohyo.sumo_networks.errors import InvalidInputError, UnknownNameError
from dohyo.sumo_networks.networks import network as network_module
from dohyo.sumo_networks.networks.catalog import load_network
from dohyo.sumo_networks.networks.entries import network_entry, network_names, network_path
from dohyo.sumo_networks.networks.network import RoadNetwork, read_network
from dohyo.sumo_networks.networks.parsing import parse_net
from tests.worlds import LANE_M, _build, crossing_for_pedestrians, lit_crossing, stop_sign_crossing, straight_road

CITIES = ("ingolstadt", "adlershof")


def anywhere(network: RoadNetwork) -> np.ndarray:
    """A preference for no lane in particular."""
    return np.zeros(len(network.lanes.ids), dtype=np.bool_)


def bent_road(length: str = "") -> RoadNetwork:
    """One lane: 30 m to the east, then 40 m to the north."""
    nodes = '<node id="a" x="0" y="0"/><node id="b" x="30" y="40"/>'
    edge = f'<edge id="ab" from="a" to="b" numLanes="1" spreadType="center" {length} shape="0,0 30,0 30,40"/>'
    return _build("bent_road", nodes, edge)


# The cities


@pytest.mark.parametrize(("name", "lights", "crossings"), [("ingolstadt", 2, 11), ("adlershof", 21, 503)])
def test_the_cities_load(name: str, lights: int, crossings: int) -> None:
    network = load_network(name)
    assert network.name == name
    assert len(network.signals.light_ids) == lights
    assert network.lanes.crossing.sum() == crossings
    assert network.lanes.drivable.any()
    assert not (network.lanes.drivable & network.lanes.crossing).any()


def test_every_network_of_the_catalog_has_a_file_and_says_where_it_comes_from() -> None:
    for name in network_names():
        entry = network_entry(name)
        assert network_path(name).exists()
        assert all([entry.title, entry.source, entry.licence])


@pytest.mark.parametrize("name", CITIES)
def test_connections_join_the_ends_of_lanes(name: str) -> None:
    network = load_network(name)
    lanes, connections = network.lanes, network.connections
    cars = lanes.drivable[connections.source] & lanes.drivable[connections.target]
    for source, target in zip(connections.source[cars], connections.target[cars], strict=True):
        gap = np.hypot(*(network.lane_shape(source)[-1] - network.lane_shape(target)[0]))
        assert gap < 0.5, (lanes.ids[source], lanes.ids[target])
    for lane in range(len(lanes.ids)):
        assert (connections.source[list(network.connections_from(lane))] == lane).all()


@pytest.mark.parametrize("name", CITIES)
def test_neighbours_lie_beside_each_other(name: str) -> None:
    network = load_network(name)
    left = network.lanes.left
    for lane in np.flatnonzero(left >= 0):
        assert network.lanes.right[left[lane]] == lane
        assert network.edge_id(lane) == network.edge_id(left[lane])
        x, y, heading = network.lane_point(int(lane), 0.0)
        dx, dy = network.lane_shape(left[lane])[0] - (x, y)
        assert dy * math.cos(heading) - dx * math.sin(heading) > 1.0, network.lanes.ids[lane]


# The cache


def test_arrays_from_the_cache_equal_a_fresh_parse(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = network_path("ingolstadt")
    monkeypatch.setenv("DOHYO_CACHE", str(tmp_path))
    fresh = read_network(path, "fresh")
    tables = parse_net(path)

    def refuse(path: Path) -> None:
        raise AssertionError("parsed again")

    monkeypatch.setattr(network_module, "parse_net", refuse)
    cached = read_network(path, "cached")
    for key, expected in tables.items():
        group, field = key.split(".")
        for network in (fresh, cached):
            found = getattr(getattr(network, group), field)
            assert found.dtype == expected.dtype, key
            np.testing.assert_array_equal(found, expected, err_msg=key)


@pytest.mark.parametrize("keep", [0, 2000, -10])
def test_a_damaged_cache_is_written_anew(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, keep: int) -> None:
    monkeypatch.setenv("DOHYO_CACHE", str(tmp_path))
    path = straight_road().network.path
    fresh = read_network(path, "road")
    (cached,) = (tmp_path / "networks").glob("*.npz")
    whole = cached.read_bytes()
    cached.write_bytes(whole[:keep])
    np.testing.assert_array_equal(read_network(path, "road").lanes.length, fresh.lanes.length)
    with np.load(cached) as again, np.load(io.BytesIO(whole)) as before:
        assert again.files == before.files


def test_a_changed_file_is_parsed_anew(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DOHYO_CACHE", str(tmp_path / "cache"))
    net = tmp_path / "road.net.xml"
    text = straight_road().network.path.read_text()
    net.write_text(text)
    before = read_network(net, "road")
    net.write_text(text.replace('speed="13.89"', 'speed="8.00"'))
    after = read_network(net, "road")
    assert before.sha256 != after.sha256
    assert before.lanes.speed[before.lanes.drivable].max() == 13.89
    assert after.lanes.speed[after.lanes.drivable].max() == 8.0


# Points on lanes


@pytest.mark.parametrize(
    ("position", "expected"),
    [
        (0.0, (0, 0, 0)),
        (10.0, (10, 0, 0)),
        (50.0, (30, 20, math.pi / 2)),
        (70.0, (30, 40, math.pi / 2)),
        (-5.0, (30, 35, math.pi / 2)),
        (-60.0, (10, 0, 0)),
        (99.0, (30, 40, math.pi / 2)),
    ],
)
def test_a_point_on_a_lane_follows_its_bend(position: float, expected: tuple[float, float, float]) -> None:
    network = bent_road()
    assert network.lane_point(network.lane_index["ab_0"], position) == pytest.approx(expected, abs=0.01)


def test_positions_are_measured_as_sumo_does_where_a_lane_is_drawn_shorter() -> None:
    network = bent_road('length="140"')
    assert network.lane_point(network.lane_index["ab_0"], 100.0) == pytest.approx((30, 20, math.pi / 2), abs=0.01)
    assert network.lane_point(network.lane_index["ab_0"], -120.0) == pytest.approx((10, 0, 0), abs=0.01)


@pytest.mark.parametrize(
    ("x", "y", "heading", "lane", "offset", "error"),
    [
        pytest.param(100, -4.8, 0.0, "w_e_0", 0.0, 0.0, id="in the middle"),
        pytest.param(100, -4.0, 0.1, "w_e_0", 0.8, 0.1, id="left of the middle"),
        pytest.param(100, -5.8, -0.1, "w_e_0", -1.0, -0.1, id="right of the middle"),
        pytest.param(100, -1.6, math.pi, "w_e_1", 0.0, -math.pi, id="against the traffic"),
        pytest.param(100, 1.6, math.pi, "e_w_1", 0.0, 0.0, id="on the other side"),
        pytest.param(100, 2.0, math.pi, "e_w_1", -0.4, 0.0, id="on the other side, right of the middle"),
        pytest.param(100, -34.0, 0.0, "w_e_0", -29.2, 0.0, id="in the field"),
        pytest.param(100, 33.0, math.pi, "e_w_0", -28.2, 0.0, id="in the other field"),
        pytest.param(1010, -4.8, 0.0, "w_e_0", 10.0, 0.0, id="past the end"),
    ],
)
def test_the_nearest_lane(x: float, y: float, heading: float, lane: str, offset: float, error: float) -> None:
    network = straight_road().network
    found, found_offset, found_error = network.nearest_lane(float(x), float(y), heading, anywhere(network))
    assert network.lanes.ids[found] == lane
    assert abs(found_offset) == pytest.approx(abs(offset), abs=0.02)
    assert offset == 0 or abs(x) > 1000 or math.copysign(1, found_offset) == math.copysign(1, offset)
    assert found_error == pytest.approx(error, abs=1e-6)


@pytest.mark.parametrize(("y", "found"), [(-34.7, True), (-34.9, False), (34.7, True), (34.9, False), (5000.0, False)])
def test_no_lane_is_near_beyond_30_metres(y: float, found: bool) -> None:
    network = straight_road().network
    lane, offset, error = network.nearest_lane(500.0, y, 0.0, anywhere(network))
    assert (lane >= 0) == found
    assert math.isnan(offset) == math.isnan(error) == (not found)


def test_a_network_of_any_extent_needs_little_memory() -> None:
    near, factor = straight_road().network, 10_000.0
    lanes = dataclasses.replace(near.lanes, points=near.lanes.points * factor)
    far = dataclasses.replace(near, lanes=lanes)
    lane, offset, _ = far.nearest_lane(0.4 * 1000.0 * factor, -4.8 * factor + 1.0, 0.0, anywhere(far))
    assert str(far.lanes.ids[lane]) == "w_e_0"
    assert offset == pytest.approx(1.0)


def test_inside_a_junction_the_route_decides_then_the_heading() -> None:
    scene = lit_crossing()
    network, straight = scene.network, scene.route
    (passage,) = straight.passages
    x, y = straight.position[straight.index((passage.entry + passage.exit) / 2)]
    for heading in (0.0, 0.7, -0.7, math.pi / 2):
        lane, offset, _ = network.nearest_lane(float(x), float(y), heading, straight.on_route)
        assert straight.on_route[lane]
        assert abs(offset) < 0.05
    northward, _, error = network.nearest_lane(float(x), float(y), math.pi / 2, anywhere(network))
    assert not straight.on_route[northward]
    assert abs(error) < 0.5


@pytest.mark.parametrize("name", CITIES)
def test_a_lane_that_contains_the_point_wins_and_else_the_nearest(name: str) -> None:
    network = load_network(name)
    lanes = np.flatnonzero(network.lanes.drivable)
    lines = np.array([shapely.LineString(network.lane_shape(int(lane))) for lane in lanes])
    tree = shapely.STRtree(lines)
    rng = np.random.default_rng(5)
    for lane in rng.choice(lanes, 150):
        x, y, _ = network.lane_point(int(lane), float(rng.uniform(0, network.lanes.length[lane])))
        x, y, heading = x + rng.normal(0, 6), y + rng.normal(0, 6), rng.uniform(-math.pi, math.pi)
        point = shapely.Point(x, y)
        near = tree.query(point, predicate="dwithin", distance=30.0)
        beyond = shapely.distance(lines[near], point) - network.lanes.width[lanes[near]] / 2
        found, offset, error = network.nearest_lane(x, y, heading, anywhere(network))
        chosen = near[np.flatnonzero(lanes[near] == found)[0]]
        assert abs(offset) == pytest.approx(float(lines[chosen].distance(point)), abs=1e-6)
        assert -math.pi <= error < math.pi
        # A misaligned lane loses to an aligned one that the point misses by a few centimetres.
        assert abs(offset) - network.lanes.width[found] / 2 <= max(float(beyond.min()), 0.0) + 0.06


# Stop lines


@pytest.mark.parametrize("name", CITIES)
def test_stop_lines_end_lanes_at_a_right_angle(name: str) -> None:
    network = load_network(name)
    for lane, line in zip(network.stop_lines.lane, network.stop_lines.segment, strict=True):
        before, end = network.lane_shape(int(lane))[-2:]
        right, left = line[:2], line[2:]
        along = (end - before) / np.hypot(*(end - before))
        np.testing.assert_allclose((right + left) / 2, end, atol=1e-6)
        assert np.hypot(*(left - right)) == pytest.approx(network.lanes.width[lane])
        assert abs(along @ (left - right)) < 1e-6
        assert along[0] * (left - right)[1] - along[1] * (left - right)[0] > 0


@pytest.mark.parametrize("name", CITIES)
def test_stop_lines_are_crossed_in_driving_direction_only(name: str) -> None:
    network = load_network(name)
    assert len(network.stop_lines.lane)
    for row, lane in enumerate(network.stop_lines.lane):
        before, end = network.lane_shape(int(lane))[-2:]
        step = 0.4 * (end - before) / np.hypot(*(end - before))
        assert row in network.crossed_stop_lines(*(end - step), *(end + step))
        assert row not in network.crossed_stop_lines(*(end + step), *(end - step))
        assert row not in network.crossed_stop_lines(*(end - 2 * step), *(end - step))
        assert row not in network.crossed_stop_lines(*(end + step), *(end + 2 * step))


@pytest.mark.parametrize("name", CITIES)
def test_every_drivable_lane_with_a_signal_has_a_lit_stop_line(name: str) -> None:
    network = load_network(name)
    connections, lines = network.connections, network.stop_lines
    lit = np.unique(connections.source[connections.signal >= 0])
    assert set(lines.lane[lines.lit]) == set(lit[network.lanes.drivable[lit]])


def test_stop_signs_have_lines_too() -> None:
    network = stop_sign_crossing().network
    signed = network.stop_lines.lane[network.stop_lines.stop_sign]
    assert {network.edge_id(lane) for lane in signed} == {"w_c", "e_c"}
    assert not network.stop_lines.lit.any()


def with_lane(path: Path, lane: str, **attributes: str) -> Path:
    """The lit crossing with other attributes of a lane; {shape} stands for the shape that it has."""
    text = lit_crossing().network.path.read_text()
    (old,) = re.findall(f'<lane id="{lane}"[^>]*>', text)
    new = old
    for key, value in attributes.items():
        new = re.sub(f'{key}="([^"]*)"', lambda match: f'{key}="{value.format(shape=match[1])}"', new)  # noqa: B023
    path.write_text(text.replace(old, new))
    return path


def test_a_repeated_point_of_a_lane_changes_nothing(tmp_path: Path) -> None:
    here = lit_crossing().network
    x, y = here.lane_shape(here.lane_index["w_c_0"])[-1]
    net = with_lane(tmp_path / "town.net.xml", "w_c_0", shape=f"{{shape}} {x:.2f},{y:.2f}")
    there = read_network(net, "town")
    np.testing.assert_array_equal(there.lanes.points, here.lanes.points)
    np.testing.assert_array_equal(there.stop_lines.segment, here.stop_lines.segment)


def test_a_lane_inside_a_junction_may_have_no_extent_as_in_nets_that_sumo_makes(tmp_path: Path) -> None:
    network = read_network(with_lane(tmp_path / "town.net.xml", ":c_0_0", shape="1,2 1,2 1,2"), "town")
    assert network.lane_shape(network.lane_index[":c_0_0"]).tolist() == [[1, 2], [1, 2]]


@pytest.mark.parametrize(
    ("attributes", "problem"),
    [
        ({"shape": "nan,nan {shape}"}, "expected finite coordinates, got nan,nan"),
        ({"shape": "{shape} 5,inf"}, "expected finite coordinates, got 5,inf"),
        ({"shape": ""}, "expected a shape of at least two points, got 0"),
        ({"shape": "1,2"}, "expected a shape of at least two points, got 1"),
        ({"shape": "1,2 1,2"}, "expected a shape of two different points, got only 1,2"),
        ({"length": "0"}, "expected a finite length above 0 m, got 0"),
        ({"length": "-5.00"}, "expected a finite length above 0 m, got -5"),
        ({"length": "nan"}, "expected a finite length above 0 m, got nan"),
        ({"speed": "nan"}, "expected a finite speed, got nan"),
    ],
)
def test_a_lane_of_an_impossible_size_or_shape_is_refused(
    attributes: dict[str, str], problem: str, tmp_path: Path
) -> None:
    net = with_lane(tmp_path / "town.net.xml", "w_c_0", **attributes)
    with pytest.raises(InvalidInputError, match=f"'{net}': lane 'w_c_0': {problem}"):
        read_network(net, "town")


# Right of way


def test_those_at_a_stop_sign_give_way_to_the_main_road_and_not_the_other_way_round() -> None:
    network = stop_sign_crossing().network
    connections = network.connections

    def straight(edge: str) -> list[int]:
        sources = [network.edge_id(int(lane)) for lane in connections.source]
        return [c for c, source in enumerate(sources) if source == edge and connections.direction[c] == "s"]

    for minor in straight("w_c") + straight("e_c"):
        for major in straight("n_c") + straight("s_c"):
            assert (minor, major) in network.gives_way_to
            assert (major, minor) not in network.gives_way_to


def test_lanes_know_who_may_use_them() -> None:
    network = crossing_for_pedestrians().network
    sidewalk, road = network.lane_index["w_c_0"], network.lane_index["w_c_1"]
    assert network.lanes.pedestrian[sidewalk]
    assert not network.lanes.drivable[sidewalk]
    assert network.lanes.drivable[road]
    assert network.lanes.right[road] == -1, "nobody changes lanes onto the sidewalk"
    assert network.lanes.crossing.sum() == 4


def test_the_drivable_area_covers_the_lanes_and_the_junction() -> None:
    area = lit_crossing().network.drivable_area
    inside = [(-100, -4.8), (-100, -1.6), (100, 4.8), (0, 0), (-1.6, 100)]
    outside = [(-100, -4 * LANE_M), (-30, -30), (300, 0)]
    assert [shapely.contains_xy(area, *point) for point in (*inside, *outside)] == [True] * 5 + [False] * 3


# What is no network


def no_lane_for_cars(path: Path) -> None:
    text = straight_road().network.path.read_text()
    path.write_text(text.replace('speed="13.89"', 'allow="pedestrian" speed="13.89"'))


def truncated(path: Path) -> None:
    path.write_text(straight_road().network.path.read_text()[:1500])


def web_page(path: Path) -> None:
    path.write_text("<!DOCTYPE html><html><head><title>404 not found</title></head><body>networks</body></html>")


def empty(path: Path) -> None:
    path.write_bytes(b"")


def noise(path: Path) -> None:
    path.write_bytes(bytes(range(256)) * 40)


def folder(path: Path) -> None:
    path.mkdir()


def nothing(path: Path) -> None:
    pass


def incomplete(path: Path) -> None:
    path.write_text('<net><edge id="e" from="a" to="b"><lane id="e_0" index="0" speed="1" length="1"/></edge></net>')


@pytest.mark.parametrize("spoil", [no_lane_for_cars, truncated, web_page, empty, noise, folder, nothing, incomplete])
def test_what_is_no_network_is_refused_by_its_path(spoil, tmp_path: Path) -> None:  # type: ignore[no-untyped-def]
    path = tmp_path / "town.net.xml"
    spoil(path)
    with pytest.raises(InvalidInputError, match=str(path)):
        load_network(str(path))


@pytest.mark.parametrize("share", [0.0, 0.01, 0.5, 0.99])
def test_a_truncated_gzip_is_refused_by_its_path(share: float, tmp_path: Path) -> None:
    data = network_path("ingolstadt").read_bytes()
    path = tmp_path / "town.net.xml.gz"
    path.write_bytes(data[: int(share * len(data))])
    with pytest.raises(InvalidInputError, match=str(path)):
        load_network(str(path))


def test_an_unknown_name_gets_the_nearest_one() -> None:
    with pytest.raises(UnknownNameError, match="did you mean 'ingolstadt'") as error:
        load_network("ingolstat")
    assert isinstance(error.value, InvalidInputError)


def test_a_network_can_be_loaded_from_its_path(tmp_path: Path) -> None:
    path = tmp_path / "town.net.xml.gz"
    path.write_bytes(gzip.compress(straight_road().network.path.read_bytes()))
    network = load_network(str(path))
    assert network.name == "town"
    assert network.path == path
    assert network.lanes.ids.tolist() == straight_road().network.lanes.ids.tolist()


def test_drives_begin_on_long_lanes_of_roads() -> None:
    lanes = load_network("town-train").lanes
    found = lanes.longer_than(40.0)
    assert 0 < len(found) < len(lanes.ids)
    assert all(lanes.drivable[lane] and not lanes.internal[lane] and lanes.length[lane] > 40.0 for lane in found)
    assert set(lanes.longer_than(60.0)) < set(found)


def test_a_lane_of_a_junction_leads_to_an_edge_also_where_lanes_lead_in_a_circle() -> None:
    network = lit_crossing().network
    lanes, connections = network.lanes, network.connections
    inside = [int(lane) for lane in np.flatnonzero(lanes.internal) if network.connections_from(int(lane))]
    for lane in inside:
        assert not str(lanes.edge_ids[network.edge_behind(lane)]).startswith(":")
    target = connections.target.copy()
    target[network.connections_from(inside[0])[0]] = inside[0]
    circle = dataclasses.replace(network, connections=dataclasses.replace(connections, target=target))
    assert circle.edge_behind(inside[0]) == lanes.edge[inside[0]]
