"""What lies ahead on a route: junctions, their signals, their signs."""

from __future__ import annotations

import pytest

from dohyo.sumo_networks.rules.red_signal import next_signal, passed_red, red_signal
from dohyo.sumo_networks.rules.right_of_way import RightOfWay, duty, passages_within, right_of_way
from dohyo.sumo_networks.world import LightState
from tests.lights import asking
from tests.worlds import lit_crossing, stop_sign_crossing

GREEN, RED, YELLOW = LightState.GREEN, LightState.RED, LightState.YELLOW


@pytest.mark.parametrize(("letters", "meaning"), [("m=", "YIELD"), ("sw", "STOP"), ("MoO", "MAJOR")])
def test_the_letters_of_sumo(letters: str, meaning: str) -> None:
    assert {right_of_way(letter) for letter in letters} == {RightOfWay[meaning]}


def test_a_junction_is_within_reach_from_its_distance_to_its_entry() -> None:
    route = lit_crossing().route
    (passage,) = route.passages
    assert [ahead for ahead, _ in passages_within(route, passage.entry - 18.0, 18.5)] == pytest.approx([18.0])
    assert list(passages_within(route, passage.entry - 18.0, 17.5)) == []
    assert list(passages_within(route, passage.entry + 0.1, 18.0)) == []


def test_where_there_is_a_signal_it_says_what_is_asked_and_elsewhere_the_sign() -> None:
    signed, lit = stop_sign_crossing().with_ego(x=-40.0).world(), lit_crossing().with_ego(x=-40.0).world()
    assert [duty(signed, passage) for passage in signed.routes[0].passages] == [RightOfWay.STOP]
    assert [duty(lit, passage) for passage in lit.routes[0].passages] == [RightOfWay.MAJOR]
    for asked in RightOfWay:
        assert [duty(asking(lit, w_c_0_s=asked), passage) for passage in lit.routes[0].passages] == [asked]
        assert [duty(asking(lit, w_c_0_r=asked), passage) for passage in lit.routes[0].passages] == [RightOfWay.MAJOR]


@pytest.mark.parametrize("light", [GREEN, YELLOW, RED])
def test_the_next_signal_is_the_one_of_the_route(light: LightState) -> None:
    scene = lit_crossing().with_lights(RED if light is GREEN else GREEN, s=light)
    x = scene.stop_line("w_c_0") - 10.0
    assert next_signal(scene.with_ego(x=x).world(), 0, 12.0) == (pytest.approx(10.0, abs=0.01), light)
    assert next_signal(scene.with_ego(x=x).world(), 0, 8.0) is None
    assert next_signal(stop_sign_crossing().with_ego(x=-20.0).world(), 0, 50.0) is None


@pytest.mark.parametrize(("light", "passed"), [(GREEN, False), (YELLOW, False), (RED, True)])
def test_a_front_on_the_route_passes_a_red_line_and_no_other(light: LightState, passed: bool) -> None:
    scene = lit_crossing().with_lights(light)
    before, after = scene.with_ego(x=scene.stop_line("w_c_0") - 2.25 - 0.5, speed=10.0).worlds(seconds=0.1)
    assert passed_red(before, after, 0) is passed
    lane = scene.network.lane_index["w_c_0"]
    assert (red_signal(after, 0, lane) >= 0) is passed
