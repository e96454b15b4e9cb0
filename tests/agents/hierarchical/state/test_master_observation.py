"""What the master sees of a tick, on hand-made worlds."""

from __future__ import annotations

import numpy as np
import pytest

from dohyo.agents.hierarchical.options.actuation import Steering
from dohyo.agents.hierarchical.options.manoeuvres import Manoeuvre
from dohyo.agents.hierarchical.state.master_observation import CRITICAL, FINISHED, FRESH, OPTIONS, MasterObservation
from dohyo.agents.rules.rules_only import RulesOnly
from dohyo.sumo_networks.sensors import make_sensors
from dohyo.sumo_networks.world import LightState
from tests.agents.hierarchical.untrained import TWIN
from tests.worlds import LANE_M, Scene, lit_crossing, straight_road


def ego(x: float = 100.0, **more: float) -> Scene:
    return straight_road().with_ego(x=x, speed=8.0, **more)


def opened(scene: Scene, rules: RulesOnly | None = None, lines: bool = True) -> MasterObservation:
    outlook = MasterObservation(TWIN, rules, lines)
    outlook.reset(scene.mission, 0)
    shown(outlook, scene)
    return outlook


def shown(outlook: MasterObservation, scene: Scene) -> None:
    world = scene.world()
    outlook.update({sensor.name: sensor.read(world, 0) for sensor in make_sensors(outlook.sensors)})


def available(outlook: MasterObservation) -> set[str]:
    return {name.value for name, may in zip(OPTIONS, outlook.available, strict=True) if may}


@pytest.mark.parametrize(
    ("scene", "expected"),
    [
        (ego(), {"lane", "braking", "left"}),
        (ego().with_actor(x=100.0, speed=8.0, left=LANE_M), {"lane", "braking"}),
        (lit_crossing().with_ego(x=-60.0).with_lights(LightState.RED), {"lane", "braking", "lights", "left"}),
        (lit_crossing().with_ego(x=60.0).with_lights(LightState.RED), {"lane", "braking", "left"}),
    ],
)
def test_what_may_begin(scene, expected):
    assert available(opened(scene)) == expected


def test_whoever_must_be_given_way_to_is_for_braking_alone():
    assert available(opened(ego().with_pedestrian(120.0, 1.5, y=-8.5, heading=np.pi / 2))) == {"braking"}
    assert available(opened(ego().with_pedestrian(150.0, 1.5, y=-8.5, heading=np.pi / 2))) == {
        "lane",
        "braking",
        "left",
    }


def test_a_change_leads_the_path_once_and_is_finished_in_its_lane():
    outlook = opened(ego())
    for x in (100.0, 101.0, 102.0):
        shown(outlook, ego(x=x))
        outlook.follow(Manoeuvre.LEFT)
        assert not outlook.finished
    assert outlook.offset == pytest.approx(LANE_M, abs=0.1)
    ahead = outlook.seen["route"]
    shown(outlook, ego(x=160.0, left=LANE_M))
    assert outlook.finished
    assert "right" in available(outlook)
    assert "left" not in available(outlook)
    assert ahead[60, 1] == pytest.approx(LANE_M, abs=0.2)
    outlook.follow(Manoeuvre.RIGHT)
    assert outlook.offset == 0.0


def test_a_junction_with_lights_is_finished_once_it_is_left():
    crossing = lit_crossing()
    outlook = opened(crossing.with_ego(x=-30.0).with_lights(LightState.GREEN))
    outlook.follow(Manoeuvre.LIGHTS)
    shown(outlook, crossing.with_ego(x=0.0).with_lights(LightState.GREEN))
    assert not outlook.finished
    shown(outlook, crossing.with_ego(x=80.0).with_lights(LightState.GREEN))
    assert outlook.finished


def test_the_vector_holds_state_options_and_flags():
    outlook = opened(ego(), RulesOnly())
    vector = outlook.vector()
    assert vector.dtype == np.float32
    assert len(vector) == outlook.encoder.size + len(OPTIONS) + 3
    assert vector[-3:][[FINISHED, CRITICAL, FRESH]].tolist() == [0.0, 0.0, 1.0]
    shown(outlook, ego().with_actor(x=106.0))
    assert outlook.vector()[-3:][[CRITICAL, FRESH]].tolist() == [1.0, 0.0]


def test_when_it_is_critical_the_rules_brake_and_without_rules_nothing_is_critical():
    scene = ego().with_actor(x=108.0)
    ruled, alone = opened(scene, RulesOnly()), opened(scene)
    assert ruled.critical
    assert ruled.obey_rules()[0] <= -5.0
    assert not alone.critical


def test_a_closed_line_is_critical_unless_lines_are_unknown():
    scene = lit_crossing().with_ego(x=-20.0, speed=10.0).with_lights(LightState.RED)
    assert opened(scene, RulesOnly()).critical
    assert not opened(scene, RulesOnly(), lines=False).critical
    assert not opened(scene).critical


def test_an_option_gets_what_it_wants():
    outlook = opened(ego())
    assert outlook.controls(np.array([0.25, 0.0], np.float32), Steering.POLICY) == pytest.approx([2.0, 0.0])


@pytest.mark.parametrize(
    ("x", "state", "expected"),
    [
        (-30.0, LightState.RED, {"lights"}),
        (-30.0, LightState.GREEN, {"lane", "braking", "lights"}),
        (-55.0, LightState.RED, {"lane", "braking", "lights"}),
    ],
)
def test_before_a_light_that_is_not_green_only_lights_may_begin(x, state, expected):
    assert available(opened(lit_crossing().with_ego(x=x).with_lights(state))) - {"left", "right"} == expected
