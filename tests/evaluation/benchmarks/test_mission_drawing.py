"""Drawn missions: of the wanted length, reachable, outside junctions, all different, the same for the same seed."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dohyo.evaluation.benchmarks.mission_drawing import draw_missions, route_lengths
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.networks.catalog import load_network
from dohyo.sumo_networks.routes.routing import plan_route
from tests.worlds import stop_sign_crossing, straight_road

TOWN = load_network("town-test")


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 2**31 - 1), st.integers(1, 12), st.floats(30, 500), st.floats(60, 400))
def test_what_holds_for_all_drawings(seed: int, count: int, low: float, span: float) -> None:
    drawing = draw_missions(TOWN, count, (low, low + span), seed)
    assert len(drawing.missions) == count
    roads = set()
    for drawn in drawing.missions:
        assert low <= drawn.route.length <= low + span
        assert plan_route(TOWN, drawn.mission).length == drawn.route.length
        for place in (drawn.mission.start, drawn.mission.goal):
            lane = TOWN.lane_index[place.lane]
            assert TOWN.lanes.drivable[lane]
            assert not TOWN.lanes.internal[lane]
            assert 0 < place.position_m < TOWN.lanes.length[lane]
        roads.add(tuple(TOWN.edge_id(TOWN.lane_index[p.lane]) for p in (drawn.mission.start, drawn.mission.goal)))
    assert len(roads) == count
    again = draw_missions(TOWN, count, (low, low + span), seed)
    assert [one.mission for one in again.missions] == [one.mission for one in drawing.missions]


def test_missions_are_spread_over_the_map_and_vary() -> None:
    missions = draw_missions(TOWN, 12, (150.0, 700.0), seed=0).missions
    starts = np.array([one.route.position[0] for one in missions])
    x0, y0, x1, y1 = TOWN.bounds
    assert (np.ptp(starts, axis=0) > 0.7 * np.array([x1 - x0, y1 - y0])).all()
    assert len({one.all_turns for one in missions}) >= 3
    assert len({one.lights for one in missions}) >= 3


def test_an_error_has_the_lengths_that_there_are() -> None:
    network = stop_sign_crossing().network
    shortest, longest = route_lengths(network)
    with pytest.raises(InvalidInputError, match=f"routes are {shortest:.0f} to {longest:.0f} m long"):
        draw_missions(network, 1, (longest + 10, longest + 20), seed=0)
    assert draw_missions(network, 1, (longest - 40, longest + 1), seed=0).missions[0].route.length > longest - 40


def test_an_error_counts_the_missions_that_there_are() -> None:
    network = stop_sign_crossing().network
    with pytest.raises(InvalidInputError, match=r"has (\d+) missions of 20 to 400 m, expected 900") as error:
        draw_missions(network, 900, (20.0, 400.0), seed=0)
    there_are = int(str(error.value).split(" has ")[1].split()[0])
    assert len(draw_missions(network, there_are, (20.0, 400.0), seed=0).missions) == there_are
    assert len(draw_missions(network, 900, (20.0, 400.0), seed=0, fewer=True).missions) == there_are


def test_a_single_road_has_no_mission() -> None:
    with pytest.raises(InvalidInputError, match="no two roads"):
        draw_missions(straight_road().network, 1, (10.0, 100.0), seed=0)


def test_no_mission_leads_through_a_light_that_only_another_program_switches() -> None:
    drawing = draw_missions(load_network("braunschweig"), 4, (300.0, 900.0), seed=0)
    assert all(one.lights == 0 for one in drawing.missions)
    assert drawing.left_out["a traffic light with a phase of more than 150 s"] > 0


def test_no_mission_leads_over_or_under_a_road_without_a_junction() -> None:
    network = load_network("a10")
    drawing = draw_missions(network, 3, (300.0, 1500.0), seed=0)
    assert drawing.left_out["a crossing of roads without a junction"] > 0
    bridges = np.array([[1757.0, 2368.3], [1766.4, 2362.4], [1767.8, 2325.5], [1755.7, 2333.5]])
    near = [np.hypot(*(one.route.position - place).T).min() for one in drawing.missions for place in bridges]
    assert min(near) > 10.0


def test_what_a_check_refuses_is_left_out_and_counted() -> None:
    drawing = draw_missions(TOWN, 3, (150.0, 700.0), seed=0, check=lambda route: _odd(route.length))
    assert all(int(one.route.length) % 2 == 0 for one in drawing.missions)
    assert drawing.left_out["odd"] > 0


def _odd(length: float) -> str | None:
    return "odd" if int(length) % 2 else None
