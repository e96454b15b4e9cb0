"""Conversion through imports: sides of the traffic and limits of countries, and repairs on request."""

from __future__ import annotations

import gzip
import re
from pathlib import Path

import numpy as np
import pytest

from dohyo.sumo_networks.errors import InvalidInputError, UnknownNameError
from dohyo.sumo_networks.networks.catalog import load_network
from dohyo.sumo_networks.networks.conversion.source_file import MIRRORED, ImportOptions
from dohyo.sumo_networks.networks.drawing import draw_map
from dohyo.sumo_networks.networks.entries import network_entry, network_path
from dohyo.sumo_networks.networks.faults import FaultKind
from dohyo.sumo_networks.networks.importing import import_network
from dohyo.sumo_networks.networks.inspection import inspect_network
from dohyo.sumo_networks.networks.network import RoadNetwork
from tests.extracts import BLACKPOOL, crossroads, roundabout
from tests.sumo_networks.networks.test_importing import TOWN, dohyo, given, netconvert


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DOHYO_HOME", str(tmp_path / "home"))


@pytest.fixture
def osm(tmp_path: Path) -> Path:
    return given(tmp_path, "crossroads.osm", crossroads())


# Countries


def test_left_hand_traffic_becomes_its_mirror_image(tmp_path: Path) -> None:
    there = given(tmp_path, "blackpool.osm", crossroads(BLACKPOOL))
    image = given(tmp_path, "image.osm", crossroads(BLACKPOOL, east=-1.0))
    done = import_network(there, "left", ImportOptions(lights=True))
    import_network(image, "image", ImportOptions(lights=True, left_hand=False))
    left, right = load_network("left"), load_network("image")
    assert MIRRORED in done.report.guessed
    assert network_entry("left").mirrored
    assert not network_entry("image").mirrored
    assert turns(left) == turns(right)
    roads = np.flatnonzero(~left.lanes.internal & left.lanes.drivable)
    shapes = [(left.lane_shape(i), right.lane_shape(right.lane_index[str(left.lanes.ids[i])])) for i in roads]
    shift = shapes[0][0][0] - shapes[0][1][0]
    for here, image_shape in shapes:
        np.testing.assert_allclose(here, image_shape + shift, atol=0.5)
    drawn = draw_map(left).lanes["10#0_1"]
    np.testing.assert_allclose(drawn[1::2], -left.lane_shape(left.lane_index["10#0_1"])[:, 0], atol=0.01)


def turns(network: RoadNetwork) -> set[tuple[str, str]]:
    """Roads into a junction with the directions in which cars may leave it."""
    connections = network.connections
    return {
        (network.edge_id(int(source)), str(direction))
        for source, direction in zip(connections.source, connections.direction, strict=True)
        if network.lanes.drivable[source] and not network.lanes.internal[source]
    }


def test_a_net_with_left_hand_traffic_is_driven_only_after_an_import(tmp_path: Path, osm: Path) -> None:
    net = tmp_path / "left.net.xml"
    netconvert("--osm-files", str(osm), "--lefthand", "--proj.utm", "-o", str(net))
    with pytest.raises(InvalidInputError, match="left-hand traffic, in which dohyo cannot drive"):
        load_network(str(net))
    assert MIRRORED in import_network(net, "left").report.guessed
    edited = tmp_path / "edited.net.xml"  # as netedit marks junctions, and another spelling
    text = net.read_text().replace(' lefthand="true"', " lefthand = '1'")
    edited.write_text(re.sub(r'(<junction id="[^:"][^>]*?)(/?>)', r'\1 customShape="true"\2', text))
    with pytest.raises(InvalidInputError, match="left-hand traffic"):
        load_network(str(edited))
    assert MIRRORED in import_network(edited, "edited").report.guessed
    with pytest.raises(InvalidInputError, match="says that traffic drives on the left"):
        import_network(net, "right", ImportOptions(left_hand=False))


def test_limits_are_those_of_the_country_by_place_or_by_option(tmp_path: Path, osm: Path) -> None:
    there = given(tmp_path, "blackpool.osm", crossroads(BLACKPOOL))
    assert set(import_network(osm, "de").report.speed_limits_kmh) == {50}
    assert set(import_network(there, "gb").report.speed_limits_kmh) == {48}
    done = import_network(osm, "za", ImportOptions(country="za"))
    assert set(done.report.speed_limits_kmh) == {60}
    assert network_entry("za").mirrored
    code, _, _ = dohyo("networks", "import", "za", "--name", "again", "--fix")
    assert code == 0
    assert network_entry("again").mirrored
    with pytest.raises(UnknownNameError, match="country named 'UK'"):
        import_network(osm, "uk", ImportOptions(country="UK"))


# Repairs


def test_a_lone_roundabout_is_kept(tmp_path: Path) -> None:
    report = import_network(given(tmp_path, "ring.osm", roundabout()), "ring").report
    assert report.lanes == 6
    assert any("since there are no others" in line for line in report.guessed)


def test_repairs_on_request(tmp_path: Path) -> None:
    slow = given(tmp_path, "slow.osm", crossroads(tags='<tag k="maxspeed" v="3"/><tag k="oneway" v="yes"/>'))
    before = import_network(slow, "before").report
    faults = [fault for fault in before.faults if fault.kind is FaultKind.LIMIT]
    assert {fault.name.split("#")[0] for fault in faults} == {"10"}
    assert before.connected_share < 1
    after = import_network(slow, "after", ImportOptions(fix=True, largest_part=True)).report
    assert not [fault for fault in after.faults if fault.kind is FaultKind.LIMIT]
    assert set(after.speed_limits_kmh) == {50}
    assert after.connected_share == 1.0
    assert any("outside the largest connected part" in line for line in after.guessed)


def test_an_endless_light_gets_a_usual_program_and_the_others_keep_theirs(tmp_path: Path) -> None:
    text = TOWN.read_text()
    (first, program), (second, kept) = programs(text)[:2]
    endless = re.sub(r'duration="\d+"', "duration = '1000'", program, count=1)
    text = text.replace(program, endless)
    text = text.replace(f'<tlLogic id="{first}" type="static"', f"<tlLogic type='static' id='{first}'")
    net = given(tmp_path, "endless.net.xml", text)
    faults = [fault for fault in import_network(net, "before").report.faults if fault.kind is FaultKind.LONG_PHASE]
    assert [(fault.name, fault.value) for fault in faults] == [(first, 1000)]
    after = import_network(net, "after", ImportOptions(fix=True)).report
    assert (after.lights, after.crossings) == (8, import_network(TOWN, "whole").report.crossings)
    assert not [fault for fault in after.faults if fault.kind is FaultKind.LONG_PHASE]
    phases = re.compile(r'duration="([\d.]+)"')
    now = dict(programs(gzip.decompress(network_path("after").read_bytes()).decode()))
    assert phases.findall(now[second]) == phases.findall(kept)


# Lanes inside junctions


def test_a_net_without_lanes_inside_its_junctions_gets_them_and_says_so(tmp_path: Path) -> None:
    bare = tmp_path / "bare.net.xml"
    netconvert("-s", str(TOWN), "-o", str(bare), "--no-internal-links", "true")
    faults = [one for one in inspect_network(load_network(str(bare))).faults if one.kind is FaultKind.NO_LANES]
    assert {fault.name for fault in faults} == set(load_network("town-test").junctions.ids)
    report = import_network(bare, "whole").report
    assert not [fault for fault in report.faults if fault.kind is FaultKind.NO_LANES]
    (line,) = [line for line in report.guessed if "lanes inside junctions added" in line]
    lanes = load_network("whole").lanes
    assert line.startswith(f"{int((lanes.internal & lanes.drivable).sum())} ")


def programs(net: str) -> list[tuple[str, str]]:
    """Programs of a net's lights, by their ids."""
    return re.findall(r'<tlLogic id="([^"]*)"(.*?)</tlLogic>', net, re.DOTALL)
