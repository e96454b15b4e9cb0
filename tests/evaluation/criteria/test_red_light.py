from __future__ import annotations

import dataclasses
import math
from typing import Literal

import pytest

from dohyo.evaluation.criteria.red_light import RedLight
from dohyo.evaluation.records.specifications import InfractionKind
from dohyo.sumo_networks.scenario import Mission, Place
from dohyo.sumo_networks.units import TICK_S
from dohyo.sumo_networks.world import LightState
from tests.worlds import LANE_M, Scene, Speed, bridge, lit_crossing, run, straight_road

RED, YELLOW, GREEN, OFF = LightState.RED, LightState.YELLOW, LightState.GREEN, LightState.OFF


def approaching(scene: Scene, front_m: float = -0.5, speed: Speed = 10.0, left: float = 0.0) -> Scene:
    """An ego whose front is so far past the western stop line."""
    return scene.with_ego(x=scene.stop_line("w_c_0") - 2.25 + front_m, speed=speed, left=left)


@pytest.mark.parametrize(("light", "count"), [(RED, 1), (YELLOW, 0), (GREEN, 0), (OFF, 0)])
def test_only_red_counts(light: LightState, count: int) -> None:
    assert len(run(approaching(lit_crossing()).with_lights(light), RedLight()).infractions) == count


def test_the_infraction_says_which_light_where_and_how_fast() -> None:
    (infraction,) = run(approaching(lit_crossing()).with_lights(RED)).infractions
    assert infraction.kind is InfractionKind.RED_LIGHT
    assert infraction.actor == "c"
    assert infraction.magnitude == pytest.approx(10.0)
    assert infraction.unit == "m/s"
    assert infraction.time_s == pytest.approx(TICK_S)
    assert infraction.at_fault is None


@pytest.mark.parametrize(("front_m", "count"), [(-1.01, 0), (-0.99, 1), (-0.01, 1), (0.01, 0)])
def test_the_front_decides_to_the_centimetre(front_m: float, count: int) -> None:
    scene = approaching(lit_crossing(), front_m).with_lights(RED)
    assert len(run(scene, RedLight(), seconds=TICK_S).infractions) == count


def late_yellow(time: float) -> LightState:
    return YELLOW if time < 0.25 else RED


@pytest.mark.parametrize(("reference", "count"), [("front", 0), ("tail", 1)])
def test_entering_on_late_yellow_counts_for_the_tail_only(reference: Literal["front", "tail"], count: int) -> None:
    scene = approaching(lit_crossing()).with_lights(late_yellow)
    assert len(run(scene, RedLight(reference)).infractions) == count


def test_the_tail_counts_once_and_not_on_green() -> None:
    scene = approaching(lit_crossing(), speed=1.0)
    assert len(run(scene.with_lights(RED), RedLight("tail"), seconds=8).infractions) == 1
    assert run(scene.with_lights(GREEN), RedLight("tail"), seconds=8).infractions == []


@pytest.mark.parametrize("front_m", [-3.0, -2.0, -1.0, -0.1])
def test_no_speed_carries_the_tail_past_a_line_unseen(front_m: float) -> None:
    scene = approaching(lit_crossing(), front_m, speed=45.0).with_lights(RED)
    assert len(run(scene, RedLight("tail")).infractions) == 1


@pytest.mark.parametrize(("lights", "count"), [({"l": RED}, 0), ({"s": RED}, 1)])
def test_the_routes_own_signal_decides(lights: dict[str, LightState], count: int) -> None:
    mission = Mission(start=Place(lane="w_c_1"), goal=Place(lane="c_e_1", position_m=-1.0))
    straight_on_the_left = dataclasses.replace(lit_crossing(), mission=mission)
    scene = approaching(straight_on_the_left).with_lights(GREEN, **lights)
    assert len(run(scene, RedLight()).infractions) == count


@pytest.mark.parametrize(("lights", "count"), [({"l": RED}, 0), ({"s": RED}, 0), ({"l": RED, "s": RED}, 1)])
def test_off_the_route_every_signal_of_the_lane_must_be_red(lights: dict[str, LightState], count: int) -> None:
    scene = approaching(lit_crossing(), left=LANE_M).with_lights(GREEN, **lights)
    assert len(run(scene, RedLight()).infractions) == count


def test_the_neighbouring_lanes_line_counts_while_the_centre_is_still_on_the_route() -> None:
    scene = lit_crossing().with_ego(x=-12.5, left=1.0, heading=0.6, speed=5).with_lights(RED)
    worlds = scene.worlds(TICK_S)
    assert worlds[-1].routes[0].on_route[worlds[-1].egos.lane[0]]
    assert len(run(worlds, RedLight()).infractions) == 1


def test_the_neighbouring_lanes_line_counts_for_the_tail_of_an_ego_back_on_the_route() -> None:
    scene = lit_crossing().with_ego(x=-8.5, left=1.2, heading=-0.5, speed=0).with_lights(RED)
    worlds = scene.worlds(TICK_S)
    assert worlds[-1].routes[0].on_route[worlds[-1].egos.lane[0]]
    assert len(run(worlds, RedLight("tail")).infractions) == 1


@pytest.mark.parametrize(
    ("left", "count"),
    [(-1.55, 1), (-1.7, 1), (-2.05, 1), (-5.0, 1), (-13.0, 0), (LANE_M + 1.7, 1), (LANE_M + 4.0, 1)],
)
def test_a_line_of_the_route_is_passed_beside_the_road_too(left: float, count: int) -> None:
    """Within the lane, on its edge, on the verge, on a path; in a field; and in the oncoming lanes."""
    scene = approaching(lit_crossing(), left=left).with_lights(RED)
    assert len(run(scene, RedLight()).infractions) == count
    assert run(scene.with_lights(GREEN), RedLight()).infractions == []


def test_who_stands_beside_the_road_before_a_red_light_passes_nothing() -> None:
    scene = approaching(lit_crossing(), speed=0.0, left=-2.0).with_lights(RED)
    assert run(scene, RedLight()).infractions == []


def test_a_lane_without_a_line_of_its_own_is_not_beside_the_road() -> None:
    mission = Mission(start=Place(lane="w_c_0"), goal=Place(lane="c_e_0", position_m=-1.0))
    scene = approaching(dataclasses.replace(lit_crossing(), mission=mission), left=LANE_M)
    assert run(scene.with_lights(GREEN, s=RED), RedLight()).infractions == []


def test_crossing_a_line_backwards_does_not_count() -> None:
    scene = lit_crossing().with_ego(x=-6, speed=10, heading=math.pi).with_lights(RED)
    assert run(scene, RedLight()).infractions == []


def test_leaving_the_junction_on_the_other_side_does_not_count() -> None:
    scene = lit_crossing().with_ego(x=-6, y=4.8, speed=10, heading=math.pi).with_lights(RED)
    assert run(scene, RedLight()).infractions == []


def test_standing_before_a_red_light_does_not_count() -> None:
    assert run(approaching(lit_crossing(), speed=0.0).with_lights(RED), RedLight()).infractions == []


def test_waiting_for_green_does_not_count() -> None:
    def light(time: float) -> LightState:
        return RED if time < 2 else GREEN

    scene = approaching(lit_crossing(), speed=lambda time: 5.0 if time > 2 else 0.0).with_lights(light)
    assert run(scene, RedLight(), seconds=4).infractions == []


def test_the_same_light_is_not_counted_twice_in_a_row() -> None:
    scene = approaching(lit_crossing()).with_lights(RED)
    first = scene.worlds(1)
    assert len(run([*first, *scene.worlds(1, after=first[-1])], RedLight()).infractions) == 1


def test_another_approach_is_another_light() -> None:
    west = approaching(lit_crossing()).with_lights(RED)
    south = lit_crossing().with_ego(x=4.8, y=-10.4 - 2.25 - 0.5, heading=math.pi / 2, speed=10).with_lights(RED)
    first = west.worlds(0.5)
    second = south.worlds(0.5, after=first[-1])
    third = west.worlds(0.5, after=second[-1])
    assert len(run([*first, *second, *third], RedLight()).infractions) == 3


def test_a_bridge_over_a_red_light_does_not_count() -> None:
    scene = bridge().with_ego(x=-20.4, y=-14.8, heading=math.pi / 4, speed=10).with_lights(RED)
    worlds = scene.worlds(2)
    (x0, y0), (x1, y1) = worlds[0].egos.position[0], worlds[-1].egos.position[0]
    assert len(scene.network.crossed_stop_lines(x0, y0, x1, y1)) == 1
    assert run(worlds, RedLight()).infractions == []


def test_a_network_without_lights_has_no_red_ones() -> None:
    assert run(straight_road().with_ego(x=50, speed=10), RedLight()).infractions == []
