"""Overpasses: roads that cross without a junction are found, and no others."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from dohyo.sumo_networks.networks.catalog import load_network
from dohyo.sumo_networks.networks.faults import Fault, FaultKind, find_faults
from dohyo.sumo_networks.networks.network import RoadNetwork, read_network
from dohyo.sumo_networks.networks.overpasses import find_overpasses
from tests.sumo_networks.networks.test_importing import given, netconvert
from tests.worlds import bridge


def built(folder: Path, nodes: str, edges: str, *options: str) -> RoadNetwork:
    plain = given(folder, "x.nod.xml", f"<nodes>{nodes}</nodes>"), given(folder, "x.edg.xml", f"<edges>{edges}</edges>")
    net = folder / "x.net.xml"
    netconvert("-n", str(plain[0]), "-e", str(plain[1]), "--no-turnarounds", "true", "-o", str(net), *options)
    return read_network(net, "x")


def overpasses(network: RoadNetwork) -> list[Fault]:
    return [fault for fault in find_faults(network) if fault.kind is FaultKind.OVERPASS]


def test_a_road_over_others_is_a_fault_with_its_place() -> None:
    faults = {fault.name: fault for fault in overpasses(bridge().network)}
    assert set(faults) == {"a_b and w_c", "a_b and junction c", "a_b and c_n"}
    assert faults["a_b and w_c"].summary == "a_b and w_c: 45 degrees between them, at x -10, y -5"


def test_a_bridge_stands_once_for_all_lanes_of_both_roads(tmp_path: Path) -> None:
    nodes = '<node id="w" x="0" y="0"/><node id="e" x="400" y="0"/>'
    nodes += '<node id="s" x="200" y="-200" z="0"/><node id="n" x="200" y="200" z="8"/>'
    edges = '<edge id="we" from="w" to="e" numLanes="3"/><edge id="sn" from="s" to="n" numLanes="2"/>'
    network = built(tmp_path, nodes, edges)
    assert len(find_overpasses(network).lanes) == 6
    (fault,) = overpasses(network)
    assert (fault.name, fault.value) == ("sn and we", 90)
    x, y = network.lane_shape(network.lane_index["sn_0"]).mean(axis=0)
    assert np.hypot(fault.x_m - x, fault.y_m - y) < 15


def test_a_ramp_that_crosses_the_road_that_it_leaves_far_from_their_junction(tmp_path: Path) -> None:
    nodes = '<node id="a" x="0" y="0"/><node id="b" x="100" y="0"/><node id="c" x="600" y="0"/>'
    nodes += '<node id="d" x="300" y="200"/>'
    edges = '<edge id="ab" from="a" to="b"/><edge id="bc" from="b" to="c"/>'
    edges += '<edge id="bd" from="b" to="d" shape="100,0 200,-100 300,-100 300,200"/>'
    assert [fault.name for fault in overpasses(built(tmp_path, nodes, edges))] == ["bc and bd"]


def test_roads_in_both_directions_on_one_line_do_not_cross(tmp_path: Path) -> None:
    nodes = '<node id="a" x="0" y="0"/><node id="b" x="200" y="10"/><node id="c" x="400" y="0"/>'
    narrow = 'spreadType="center" shape="0,0 100,3 200,10 300,6 400,0"'
    edges = f'<edge id="ac" from="a" to="c" {narrow}/><edge id="ca" from="c" to="a" spreadType="center"/>'
    assert overpasses(built(tmp_path, nodes, edges)) == []
    edges = '<edge id="ab" from="a" to="b" spreadType="center"/><edge id="bc" from="b" to="c" spreadType="center"/>'
    edges += '<edge id="ca" from="c" to="a" spreadType="center" shape="400,0 200,10 0,0"/>'
    assert overpasses(built(tmp_path, nodes, edges)) == []


def test_of_the_networks_that_come_with_dohyo_only_the_motorway_has_some() -> None:
    crossed = {name for fault in overpasses(load_network("a10")) for name in fault.name.split(" and ")}
    assert crossed == {"240042212", "308396219", "256366925", "4054057"}
    for name in ("adlershof", "braunschweig", "ingolstadt"):
        assert not len(find_overpasses(load_network(name)).lanes)
