"""The networks drawn for dohyo: their numbers, that they can be rebuilt, and that SUMO's traffic flows in them."""

from __future__ import annotations

import itertools
import json
import random
import re
import subprocess
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
import shapely
import sumo
from PIL import Image

from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.networks.catalog import load_network
from dohyo.sumo_networks.networks.drawing import draw_map, svg, write_map
from dohyo.sumo_networks.networks.entries import CATALOG, builtin_names, network_entry, network_names, network_path
from dohyo.sumo_networks.networks.importing import build_network
from dohyo.sumo_networks.networks.inspection import inspect_network, network_size
from dohyo.sumo_networks.networks.network import RoadNetwork, read_network
from dohyo.sumo_networks.routes.routing import plan_route
from dohyo.sumo_networks.scenario import Mission, Place

TOWNS = ("town-train", "town-test")
OURS = (*TOWNS, "district")
EIGHT = (*OURS, "freeway", "a10", "adlershof", "braunschweig", "ingolstadt")


def net(name: str) -> ET.Element:
    return ET.parse(network_path(name)).getroot()


def centreline_km(name: str) -> float:
    """Length of the streets as drawn, node to node, each once."""
    folder = CATALOG / name
    nodes = {
        n.get("id"): (float(n.attrib["x"]), float(n.attrib["y"]))
        for n in ET.parse(folder / f"{name}.nod.xml").iter("node")
    }
    total = 0.0
    for edge in ET.parse(folder / f"{name}.edg.xml").iter("edge"):
        if edge.attrib["id"].startswith("-"):
            continue
        shape = edge.get("shape")
        points = (
            [tuple(map(float, p.split(","))) for p in shape.split()]
            if shape
            else [nodes[edge.get("from")], nodes[edge.get("to")]]
        )
        total += shapely.LineString(points).length
    return total / 1000


@pytest.mark.parametrize("name", builtin_names())
def test_the_size_in_an_entry_is_that_of_the_net(name: str) -> None:
    assert network_entry(name).size == network_size(load_network(name))


def roads(network: RoadNetwork) -> list[int]:
    return np.flatnonzero(network.lanes.drivable & ~network.lanes.internal).tolist()


# The catalog


def test_the_catalog_has_the_eight_networks() -> None:
    assert set(EIGHT) <= set(network_names())
    for name in EIGHT:
        assert load_network(name).lanes.drivable.any()


# Their numbers


@pytest.mark.parametrize(("name", "km", "junctions"), [("town-train", 2.9, 11), ("town-test", 1.4, 8)])
def test_the_towns_are_as_large_as_they_should_be(name: str, km: float, junctions: int) -> None:
    report = inspect_network(load_network(name))
    assert centreline_km(name) == pytest.approx(km, rel=0.05)
    assert report.road_km == pytest.approx(km, rel=0.05)
    assert report.lights == report.junctions["traffic_light"] == junctions
    assert all(20 <= limit <= 50 for limit in report.speed_limits_kmh)


@pytest.mark.parametrize("name", TOWNS)
def test_every_light_of_the_towns_stands_at_a_t_junction_with_crossings_on_all_arms(name: str) -> None:
    root = net(name)
    for junction in root.iter("junction"):
        if junction.get("type") != "traffic_light":
            continue
        here = junction.get("id")
        incoming = [edge for edge in root.iter("edge") if edge.get("to") == here]
        outgoing = [edge for edge in root.iter("edge") if edge.get("from") == here]
        crossings = [edge for edge in root.iter("edge") if str(edge.get("id")).startswith(f":{here}_c")]
        assert (len(incoming), len(outgoing), len(crossings)) == (3, 3, 3)


@pytest.mark.parametrize("name", TOWNS)
def test_the_towns_have_one_lane_per_direction_and_sidewalks_everywhere(name: str) -> None:
    for edge in net(name).iter("edge"):
        if not edge.get("function"):
            assert [lane.get("allow") == "pedestrian" for lane in edge.iter("lane")] == [True, False]


def test_the_towns_differ() -> None:
    blocks, bends = [], []
    for name in TOWNS:
        network = load_network(name)
        blocks.append(float(np.median(network.lanes.length[roads(network)])))
        bends.append(float(np.median([_turning_per_metre(network, lane) for lane in roads(network)])))
    assert blocks[1] < 0.75 * blocks[0]
    assert bends[1] > 1.25 * bends[0]


def _turning_per_metre(network: RoadNetwork, lane: int) -> float:
    steps = np.diff(network.lane_shape(lane), axis=0)
    heading = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
    return float(np.abs(np.diff(heading)).sum() / network.lanes.length[lane]) if len(heading) > 1 else 0.0


def test_the_district_has_what_it_promises() -> None:
    network = load_network("district")
    report = inspect_network(network)
    x0, _, x1, _ = network.bounds
    assert 2000 < x1 - x0 < 3000
    assert report.junctions["right_before_left"] >= 6
    assert report.junctions["priority_stop"] >= 2
    assert report.junctions["priority"] >= 2
    assert report.stop_signs >= 2
    assert report.lights == 4
    (roundabout,) = net("district").iter("roundabout")
    assert len(roundabout.attrib["nodes"].split()) == 4
    avenue = network.lanes_of_edge["avenue_2_far_west"]
    assert sum(bool(network.lanes.drivable[lane]) for lane in avenue) == 2


def test_the_avenue_needs_lane_changes() -> None:
    network = load_network("district")
    right = network.lanes_of_edge["avenue_1_far_west"][1]
    mission = Mission(
        start=Place(lane=str(network.lanes.ids[right])), goal=Place(lane="hill_street_1_1", position_m=50)
    )
    assert len(plan_route(network, mission).lane_changes) >= 1


# Driving and walking


@pytest.mark.parametrize("name", OURS)
def test_every_place_leads_to_every_other(name: str) -> None:
    report = inspect_network(load_network(name))
    assert report.connected_share == 1.0
    assert report.outside == ()
    assert report.dead_ends == ()
    assert report.faults == ()


@pytest.mark.parametrize("name", TOWNS)
def test_a_route_leads_between_any_two_streets(name: str) -> None:
    network = load_network(name)
    lanes = roads(network)
    for start, goal in itertools.permutations(lanes[:: max(1, len(lanes) // 8)], 2):
        ids = [str(network.lanes.ids[lane]) for lane in (start, goal)]
        route = plan_route(network, Mission(start=Place(lane=ids[0]), goal=Place(lane=ids[1], position_m=10)))
        # A car at full lock turns in 4 m.
        assert np.abs(route.curvature).max() < 1 / 4


@pytest.mark.parametrize("name", OURS)
def test_every_sidewalk_can_be_reached_on_foot(name: str) -> None:
    root = net(name)
    walkable = {
        (edge.get("id"), lane.get("index"))
        for edge in root.iter("edge")
        for lane in edge.iter("lane")
        if "pedestrian" in (lane.get("allow") or "")
    }
    near: dict[tuple[str | None, str | None], set[tuple[str | None, str | None]]] = {place: set() for place in walkable}
    for link in root.iter("connection"):
        a, b = (link.get("from"), link.get("fromLane")), (link.get("to"), link.get("toLane"))
        if a in walkable and b in walkable:
            near[a].add(b)
            near[b].add(a)
    reached, stack = set(), [next(iter(sorted(walkable)))]
    while stack:
        place = stack.pop()
        if place not in reached:
            reached.add(place)
            stack += near[place]
    assert reached == walkable


@pytest.mark.parametrize("name", OURS)
def test_lights_give_yellow_for_3_s_and_all_red_for_2_s(name: str) -> None:
    programs = list(net(name).iter("tlLogic"))
    assert programs
    for program in programs:
        phases = [(float(p.attrib["duration"]), p.attrib["state"]) for p in program.iter("phase")]
        for (duration, state), (_, following) in zip(phases, phases[1:] + phases[:1], strict=True):
            if "y" in state:
                assert duration == 3
                assert not re.search("[GgYy]", following)
        for number, (duration, state) in enumerate(phases):
            if not re.search("[GgYy]", state):
                assert duration == 2
                assert "y" in phases[number - 1][1]


@pytest.mark.parametrize("name", [*OURS, "freeway"])
def test_the_committed_net_is_what_its_source_gives(name: str, tmp_path: Path) -> None:
    built = build_network(CATALOG / name, tmp_path / f"{name}.net.xml")
    ours, again = load_network(name), read_network(built, name)
    np.testing.assert_array_equal(ours.lanes.ids, again.lanes.ids)
    np.testing.assert_allclose(ours.lanes.length, again.lanes.length, atol=0.02)
    np.testing.assert_allclose(ours.lanes.points, again.lanes.points, atol=0.02)
    for field in ("source", "target", "signal", "control", "direction"):
        np.testing.assert_array_equal(getattr(ours.connections, field), getattr(again.connections, field))
    lights = [[ET.tostring(p) for p in root.iter("tlLogic")] for root in (net(name), ET.parse(built).getroot())]
    assert lights[0] == lights[1]
    assert network_path(name).stat().st_size < 2e6


def test_building_needs_a_configuration(tmp_path: Path) -> None:
    with pytest.raises(InvalidInputError, match="netccfg"):
        build_network(tmp_path)


# SUMO's own traffic


@pytest.mark.parametrize(("name", "every_s"), [("town-train", 6), ("town-test", 6), ("district", 3)])
def test_sumos_traffic_flows_without_jams_and_collisions(name: str, every_s: int, tmp_path: Path) -> None:
    """Twenty minutes of random trips by car and on foot, in the numbers of NoCrash's regular traffic."""
    network, rng = load_network(name), random.Random(1)
    edges = [edge for edge in network.lanes_of_edge if not edge.startswith(":")]
    trips = []
    for number, second in enumerate(range(0, 1200, every_s)):
        a, b = rng.sample(edges, 2)
        trips.append(f'<trip id="v{number}" depart="{second}" from="{a}" to="{b}"/>')
        a, b = rng.sample(edges, 2)
        trips.append(f'<person id="p{number}" depart="{second}"><walk from="{a}" to="{b}"/></person>')
    (tmp_path / "x.rou.xml").write_text(f"<routes>{''.join(trips)}</routes>")
    command = [str(Path(sumo.SUMO_HOME) / "bin" / "sumo"), "-n", str(network_path(name)), "-r", "x.rou.xml"]
    command += ["--step-length", "0.1", "--time-to-teleport", "-1", "--end", "6000", "--no-step-log", "--seed", "1"]
    command += ["--collision.action", "warn", "--collision.check-junctions", "true", "--collision.mingap-factor", "0"]
    command += ["--statistic-output", "statistics.xml", "--xml-validation", "never"]
    subprocess.run(command, cwd=tmp_path, check=True, capture_output=True)
    statistics = ET.parse(tmp_path / "statistics.xml").getroot()
    vehicles, safety = statistics.find("vehicles"), statistics.find("safety")
    assert vehicles is not None
    assert safety is not None
    assert int(vehicles.attrib["inserted"]) == len(trips) // 2
    assert (vehicles.get("running"), vehicles.get("waiting")) == ("0", "0")
    persons = statistics.find("persons")
    assert persons is not None
    assert persons.get("running") == "0"
    assert safety.get("collisions") == "0"


# Maps


@pytest.mark.parametrize("name", EIGHT)
def test_the_map_shows_every_lane_crossing_and_light(name: str) -> None:
    network = load_network(name)
    text = svg(draw_map(network))
    ET.fromstring(text)
    drawn = set(re.findall(r'data-lane="([^"]*)"', text))
    long = network.lanes.drivable & (network.lanes.length > 0.2)
    assert {str(lane) for lane in network.lanes.ids[long]} <= drawn
    assert text.count("data-crossing=") == network.lanes.crossing.sum()
    assert text.count("data-light=") == network.stop_lines.lit.sum()
    assert text.count("data-stop-sign=") == (network.stop_lines.stop_sign & ~network.stop_lines.lit).sum()


def test_the_map_is_written_in_three_formats(tmp_path: Path) -> None:
    network = load_network("town-test")
    for ending in ("png", "svg", "html"):
        write_map(network, tmp_path / f"map.{ending}")
    with Image.open(tmp_path / "map.png") as picture:
        assert min(picture.size) > 500
        assert len(picture.getcolors(1 << 20) or []) > 5
    page = (tmp_path / "map.html").read_text()
    assert "<svg" in page
    assert "http://www.w3.org/2000/svg" in page
    assert not re.search(r'(src|href)="http', page)
    lanes = json.loads(re.search(r"^const LANES = (\{.*?\});", page, re.MULTILINE)[1])  # type: ignore[index]
    lane = network.lane_index["quay_1_1"]
    assert lanes["quay_1_1"][0] == pytest.approx(network.lanes.length[lane], abs=0.01)
    assert lanes["quay_1_1"][1:] == pytest.approx(network.lane_shape(lane).ravel(), abs=0.01)
    with pytest.raises(InvalidInputError, match=r"png, \.svg or \.html"):
        write_map(network, tmp_path / "map.gif")
