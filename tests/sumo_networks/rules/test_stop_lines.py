"""Stop lines: those that are passed beside the road."""

from __future__ import annotations

import dataclasses

import pytest

from dohyo.sumo_networks.rules.stop_lines import passed_stop_lines
from tests.worlds import lit_crossing


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("lane", ["w_c_0", "w_c_1"])
def test_a_lane_without_a_direction_hides_no_line_beside_the_road(lane: str) -> None:
    scene = lit_crossing()
    network, lanes = scene.network, scene.network.lanes
    worlds = scene.with_ego(x=scene.stop_line("w_c_0") - 2.75, speed=10.0, left=-5.0).worlds(seconds=0.1)
    last, points = lanes.start[network.lane_index[lane] + 1] - 1, lanes.points.copy()
    points[last - 1] = points[last]
    twisted = dataclasses.replace(network, lanes=dataclasses.replace(lanes, points=points))
    after = dataclasses.replace(worlds[-1], network=twisted)
    expected = passed_stop_lines(worlds[0], worlds[-1], 0)
    assert len(expected) == 1
    assert passed_stop_lines(worlds[0], after, 0) == expected
