"""What ends an episode of a sub-policy, on hand-made worlds."""

from __future__ import annotations

import dataclasses
from itertools import pairwise

import pytest

from dohyo.agents.hierarchical.environments.endings import End, Endings
from dohyo.agents.hierarchical.options.manoeuvres import DRIVE, Manoeuvre
from dohyo.sumo_networks.world import EventPhase, EventState, LightState, World
from tests.worlds import Scene, lit_crossing, straight_road


def watched(
    what: str,
    worlds: list[World],
    lateral: float = 0.0,
    held: bool = False,
    arrived: bool = False,
    out: bool = False,
) -> tuple[End | None, float]:
    """Why it ended, and after how long; None: not at all."""
    endings = Endings(what, worlds[0])
    for before, after in pairwise(worlds):
        if endings.update(before, after, lateral, held, arrived, out) is not None:
            return endings.end, after.time
    return None, worlds[-1].time


def driving(speed: float = 8.0) -> Scene:
    return straight_road().with_ego(x=100.0, speed=speed)


def test_driving_on_ends_nothing():
    assert watched(Manoeuvre.LANE, driving().worlds(8.0)) == (None, 8.0)


@pytest.mark.parametrize(("speed", "end"), [(0.27, End.STANDING), (0.29, None)])
def test_5_s_below_1_km_h_end_it(speed, end):
    found, when = watched(Manoeuvre.LANE, driving(speed).worlds(7.0))
    assert found is end
    if end is not None:
        assert when == pytest.approx(5.0)


def test_a_lawful_stop_lasts_as_long_as_it_takes():
    assert watched(Manoeuvre.LIGHTS, at_red(0.0).worlds(30.0), held=True) == (None, 30.0)


def at_red(speed: float) -> Scene:
    crossing = lit_crossing()
    return crossing.with_ego(x=crossing.stop_line("w_c_0") - 4.0, speed=speed).with_lights(LightState.RED)


def test_the_5_s_begin_anew_after_a_lawful_stop():
    worlds = driving(0.0).worlds(12.0)
    endings = Endings(Manoeuvre.LANE, worlds[0])
    ends = [endings.update(a, b, 0.0, held=40 <= i < 60, arrived=False, out=False) for i, (a, b) in
            enumerate(pairwise(worlds))]  # fmt: skip
    assert ends.index(End.STANDING) == 60 + 50 - 1


@pytest.mark.parametrize(("lateral", "end"), [(2.4, None), (-2.6, End.INFRACTION)])
def test_more_than_2_5_m_from_the_path_is_an_infraction(lateral, end):
    assert watched(Manoeuvre.LANE, driving().worlds(1.0), lateral=lateral)[0] is end


def test_a_collision_is_an_infraction_of_every_manoeuvre():
    scene = lit_crossing().with_ego(x=-80.0, speed=8.0).with_actor(x=-70.0).with_lights(LightState.GREEN)
    worlds = scene.worlds(3.0)
    assert {watched(what, worlds)[0] for what in (*Manoeuvre, DRIVE)} == {End.INFRACTION}


def test_a_red_light_is_one_where_lights_are_the_task():
    worlds = at_red(8.0).worlds(3.0)
    assert watched(Manoeuvre.LIGHTS, worlds)[0] is End.INFRACTION
    assert watched(DRIVE, worlds)[0] is End.INFRACTION
    assert watched(Manoeuvre.LANE, worlds)[0] is None


def test_a_change_is_done_2_s_after_it_has_led_into_its_lane():
    end, when = watched(Manoeuvre.LEFT, driving().worlds(5.0), arrived=True)
    assert (end, when) == (End.DONE, pytest.approx(2.0))
    assert watched(Manoeuvre.LEFT, driving().worlds(5.0)) == (None, 5.0)


def test_a_light_is_done_10_m_behind_its_junction():
    crossing = lit_crossing().with_ego(x=-25.0, speed=10.0).with_lights(LightState.GREEN)
    worlds = crossing.worlds(8.0)
    end, when = watched(Manoeuvre.LIGHTS, worlds)
    there = next(w for w in worlds if w.time == when).egos.progress[0]
    assert end is End.DONE
    assert there == pytest.approx(crossing.route.passages[0].exit + 10.0, abs=1.1)


def test_braking_is_done_15_m_after_all_is_over():
    def happening(world: World) -> World:
        phase = EventPhase.DONE if world.time > 2.0 else EventPhase.ACTIVE
        event = EventState("event", "hard_brake", 0, phase, 0.0, 2.0, (), 0.0)
        return dataclasses.replace(world, events=(event,))

    end, when = watched(Manoeuvre.BRAKING, [happening(world) for world in driving(10.0).worlds(8.0)])
    assert (end, when) == (End.DONE, pytest.approx(2.1 + 1.5, abs=0.15))


def test_time_is_the_last_reason():
    assert watched(Manoeuvre.LANE, driving().worlds(1.0), out=True)[0] is End.TIME
    assert watched(Manoeuvre.LANE, driving().worlds(1.0), lateral=3.0, out=True)[0] is End.INFRACTION
