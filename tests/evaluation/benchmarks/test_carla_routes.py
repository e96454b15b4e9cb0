"""CARLA route files: through OpenDRIVE and back, every mission lies where its waypoints were."""

from __future__ import annotations

import json
import re
import subprocess
from pathlib import Path

import numpy as np
import pytest
import sumo
from typer.testing import CliRunner

from dohyo.evaluation.benchmarks.benchmark import load_benchmark
from dohyo.evaluation.benchmarks.carla_routes import import_routes, net_offset, read_routes
from dohyo.evaluation.benchmarks.cells import Protocol
from dohyo.evaluation.benchmarks.writing import write_benchmark
from dohyo.service.cli import app
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.networks.catalog import load_network
from dohyo.sumo_networks.networks.entries import network_path
from dohyo.sumo_networks.networks.importing import import_network
from dohyo.sumo_networks.routes.route import Route
from dohyo.sumo_networks.routes.routing import plan_route
from dohyo.sumo_networks.scenario import Mission, Place, Traffic

Points = list[tuple[float, float]]

# Routes through town-test, drawn in its own frame, and how far along each a waypoint is given.
DRIVES = (
    Mission(start=Place(lane="quay_1_1", position_m=20), goal=Place(lane="rampart_2_1", position_m=60)),
    Mission(start=Place(lane="-rampart_3_1", position_m=10), goal=Place(lane="green_lane_1", position_m=40)),
    Mission(start=Place(lane="baker_street_4_1", position_m=15), goal=Place(lane="-quay_1_1", position_m=80)),
)


# CARLA's towns say where on Earth they pretend to be; that must not move a waypoint.
GEOREFERENCE = "<geoReference><![CDATA[+proj=tmerc +lat_0=4.9e+1 +lon_0=8.0e+0]]></geoReference>"


@pytest.fixture(scope="module", params=["", GEOREFERENCE], ids=["plain", "georeferenced"])
def town(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> object:
    """town-test, sent through OpenDRIVE, as a CARLA town would come."""
    folder = tmp_path_factory.mktemp("carla")
    xodr = folder / "Town77.xodr"
    command = [str(Path(sumo.SUMO_HOME) / "bin" / "netconvert"), "-s", str(network_path("town-test"))]
    subprocess.run([*command, "--opendrive-output", str(xodr)], check=True, capture_output=True)
    xodr.write_text(re.sub(r"(<header[^>]*)/>", rf"\1>{request.param}</header>", xodr.read_text()))
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("DOHYO_HOME", str(folder / "home"))
        import_network(xodr, "town77")
        yield "town77"


def carla(route: Route, every_m: float) -> Points:
    """Waypoints of a route in CARLA's frame: y the other way."""
    return [(float(x), float(-y)) for x, y in route.position[:: round(every_m)]] + [
        (float(route.position[-1, 0]), float(-route.position[-1, 1]))
    ]


def drives(every_m: float = 25.0) -> list[Points]:
    network = load_network("town-test")
    return [carla(plan_route(network, mission), every_m) for mission in DRIVES]


def new_form(routes: list[Points], town: str = "Town77") -> str:
    body = "".join(
        f'<route id="{i}" town="{town}"><weathers/><waypoints>'
        + "".join(f'<position x="{x:.3f}" y="{y:.3f}" z="0.5"/>' for x, y in points)
        + "</waypoints><scenarios/></route>"
        for i, points in enumerate(routes)
    )
    return f"<?xml version='1.0' encoding='UTF-8'?>\n<routes>{body}</routes>"


def old_form(routes: list[Points]) -> str:
    body = "".join(
        f'<route id="{i}" map="Town77">'
        + "".join(f'<waypoint pitch="0" roll="0" yaw="90" x="{x:.3f}" y="{y:.3f}" z="0"/>' for x, y in points)
        + "</route>"
        for i, points in enumerate(routes)
    )
    return f"<routes>{body}</routes>"


def ego_form(routes: list[Points]) -> str:
    body = "".join(
        f'<route id="{i}"><ego_vehicle id="hero">'
        + "".join(f'<waypoint x="{x:.3f}" y="{y:.3f}" yaw="90" z="1.3"/>' for x, y in points)
        + "</ego_vehicle></route>"
        for i, points in enumerate(routes)
    )
    return f"<routes>{body}</routes>"


def given(folder: Path, text: str) -> Path:
    path = folder / "routes.xml"
    path.write_text(text)
    return path


@pytest.mark.parametrize("form", [new_form, old_form, ego_form])
def test_missions_lie_where_the_waypoints_were(town: str, tmp_path: Path, form: object) -> None:
    made = import_routes(given(tmp_path, form(drives())), town)  # type: ignore[operator]
    network, offset = load_network(town), net_offset(load_network(town))
    assert offset != (0.0, 0.0)
    (missions,) = made.benchmark.missions.values()
    assert [mission.name for mission in missions] == ["route-0", "route-1", "route-2"]
    for mission, points, drive, snap in zip(missions, drives(), DRIVES, made.snaps, strict=True):
        for place, (x, y) in ((mission.start, points[0]), (mission.goal, points[-1])):
            lane = network.lane_index[place.lane]
            found = np.array(network.lane_point(lane, place.position_m)[:2]) - offset
            assert np.hypot(*(found - (x, -y))) < 0.5
        assert max(snap.moved_m) < 0.5
        # The way between is the same too, not only its ends.
        ours, original = plan_route(network, mission), plan_route(load_network("town-test"), drive)
        assert ours.length == pytest.approx(original.length, abs=2.0)
        away = [np.hypot(*(original.position - (p - offset)).T).min() for p in ours.position]
        assert max(away) < 1.5


def test_the_way_follows_the_waypoints_and_not_the_shortest_route(town: str, tmp_path: Path) -> None:
    network = load_network("town-test")
    detour = Mission(start=DRIVES[0].start, goal=DRIVES[0].goal, via=("-rampart_3", "-rampart_2"))
    direct = plan_route(network, DRIVES[0]).length
    try:
        route = plan_route(network, detour)
    except InvalidInputError:
        detour = Mission(start=DRIVES[0].start, goal=DRIVES[0].goal, via=("baker_street_3",))
        route = plan_route(network, detour)
    assert route.length > direct + 20
    benchmark = import_routes(given(tmp_path, new_form([carla(route, 20.0)])), town).benchmark
    (mission,) = benchmark.missions["all"]
    assert plan_route(load_network(town), mission).length == pytest.approx(route.length, abs=2.0)


def test_the_written_file_is_the_same_benchmark(town: str, tmp_path: Path) -> None:
    benchmark = import_routes(given(tmp_path, new_form(drives())), town, name="carla-77").benchmark
    read = load_benchmark(str(write_benchmark(benchmark, tmp_path / "carla-77.toml")))
    assert read == benchmark
    assert read.sha256 == benchmark.sha256


def test_waypoints_beside_the_road_are_moved_and_told(town: str, tmp_path: Path) -> None:
    routes = drives()
    (x, y), (x1, y1) = routes[0][:2]
    along = np.array([x1 - x, y1 - y]) / np.hypot(x1 - x, y1 - y)
    routes[0][0] = (x - along[1] * 3.0, y + along[0] * 3.0)  # to the right in CARLA's frame
    snaps = import_routes(given(tmp_path, new_form(routes)), town).snaps
    assert snaps[0].moved_m[0] == pytest.approx(3.0, abs=0.4)


def test_all_waypoints_far_from_the_road_are_named_or_their_routes_skipped(town: str, tmp_path: Path) -> None:
    routes = drives()
    for route, waypoint in ((0, 1), (1, 2), (1, 3)):
        x, y = routes[route][waypoint]
        routes[route][waypoint] = (x + 400.0, y)
    file = given(tmp_path, new_form(routes))
    with pytest.raises(InvalidInputError, match="2 of 3 routes make no missions; --skip leaves them out") as caught:
        import_routes(file, town)
    named = re.findall(r"route \d|waypoint \d", str(caught.value))
    assert named == ["route 0", "waypoint 2", "route 1", "waypoint 3", "waypoint 4"]
    assert str(file) in str(caught.value)
    made = import_routes(file, town, skip=True)
    assert [mission.name for mission in made.benchmark.missions["all"]] == ["route-2"]
    assert list(made.skipped) == ["0", "1"]


def test_ends_inside_junctions_are_moved_out_of_them(town: str, tmp_path: Path) -> None:
    network, drive = load_network("town-test"), DRIVES[0]
    route = plan_route(network, drive)
    inside = np.array([network.lanes.internal[lane] for lane in route.lane])
    first = int(np.flatnonzero(inside)[0]) + 3  # some metres inside the first junction
    points = [(float(x), float(-y)) for x, y in route.position]
    made = import_routes(given(tmp_path, ego_form([points[: first + 1], [points[first], points[-1]]])), town)
    before, after = made.snaps
    assert re.fullmatch(r"goal moved by \d+\.\d m out of a junction", before.notes[0])
    assert re.fullmatch(r"start moved by \d+\.\d m out of a junction", after.notes[0])
    to, onward = made.benchmark.missions["all"]
    lanes = load_network(town).lane_index
    assert to.goal.lane in lanes
    assert to.goal.lane != onward.start.lane
    assert plan_route(load_network(town), onward).length < route.length - 3


def test_one_town_at_a_time(town: str, tmp_path: Path) -> None:
    text = new_form(drives()).replace('id="1" town="Town77"', 'id="1" town="Town78"')
    with pytest.raises(InvalidInputError, match="'Town77', 'Town78': choose one with --town"):
        import_routes(given(tmp_path, text), town)
    benchmark = import_routes(given(tmp_path, text), town, town="Town77").benchmark
    assert [mission.name for mission in benchmark.missions["all"]] == ["route-0", "route-2"]
    with pytest.raises(InvalidInputError, match="no route of 'Town99'"):
        import_routes(given(tmp_path, text), town, town="Town99")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<routes/>", "no <route>"),
        ("<routes><route id='7'/></routes>", "route 7: expected two or more finite waypoints, got 0"),
        ("<routes><route id='7'><waypoint x='1' y='b'/><waypoint x='1' y='2'/></route></routes>", "numbers x and y"),
        ("<routes><route id='7'><waypoint x='nan' y='1'/><waypoint x='1' y='2'/></route></routes>", "finite"),
        ("<routes><route id='7'><waypoint x='1'/><waypoint x='1' y='2'/></route></routes>", "numbers x and y"),
        ("<osm/>", "root element <routes>"),
        ("<routes>", "well-formed"),
        ('<!DOCTYPE routes [<!ENTITY a "b">]><routes>&a;</routes>', "DOCTYPE"),
    ],
)
def test_bad_route_files(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(InvalidInputError, match=message):
        read_routes(given(tmp_path, text))


def test_every_bad_route_of_a_file_is_named(tmp_path: Path) -> None:
    text = "<routes><route id='7'/><route id='8'><npc/></route></routes>"
    with pytest.raises(InvalidInputError, match=r"route 7: .* holds nothing; route 8: .* holds <npc>"):
        read_routes(given(tmp_path, text))


def test_a_nocrash_file_becomes_nocrash(town: str, tmp_path: Path) -> None:
    made = import_routes(
        given(tmp_path, ego_form(drives())),
        town,
        protocol=Protocol.NOCRASH,
        traffic=Traffic(vehicles=3),
        conditions=("train", "test"),
    )
    assert made.benchmark.stop_on_collision
    assert [cell.name for cell in made.benchmark.cells] == ["train", "test"]
    assert made.benchmark.headline == "nocrash_success"


def test_twice_the_same_id_is_an_error(town: str, tmp_path: Path) -> None:
    with pytest.raises(InvalidInputError, match="unique"):
        import_routes(given(tmp_path, new_form(drives()).replace('id="1"', 'id="0"')), town)


def test_the_command(town: str, tmp_path: Path) -> None:
    out = tmp_path / "carla.toml"
    arguments = ["benchmarks", "import", str(given(tmp_path, new_form(drives()))), "--network", town]
    result = CliRunner().invoke(app, [*arguments, "--out", str(out), "--vehicles", "5", "--json"])
    assert result.exit_code == 0, result.output
    assert [len(route["moved_m"]) for route in json.loads(result.output)["routes"]] == [len(p) for p in drives()]
    benchmark = load_benchmark(str(out))
    assert benchmark.cells[0].traffic.vehicles == 5
    assert len(benchmark.scenarios(seeds=[0])) == 3
    before = out.read_bytes()
    again = CliRunner().invoke(app, [*arguments, "--out", str(out)])
    assert "carla.toml' exists; replace it with --force" in str(again.exception)
    assert out.read_bytes() == before
    assert CliRunner().invoke(app, [*arguments, "--out", str(out), "--force"]).exit_code == 0
    assert out.read_bytes() != before
