"""The scenarios of the sub-policies are what they say."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from dohyo.agents.hierarchical.environments.scenarios import (
    BRAKING_EVENTS,
    GIVING_WAY,
    LIGHTLESS_M,
    TIME_LIMITS_S,
    careful_speed,
    draw_scenario,
)
from dohyo.agents.hierarchical.options.manoeuvres import CHANGES, DRIVE, Course, Manoeuvre
from dohyo.agents.planning.surroundings import Surroundings
from dohyo.sumo_networks.envs.driving_env import DrivingEnv
from dohyo.sumo_networks.networks.catalog import load_network
from dohyo.sumo_networks.routes.route import Route
from dohyo.sumo_networks.routes.routing import plan_route
from dohyo.sumo_networks.scenario import Scenario
from dohyo.sumo_networks.seeds import HELD_OUT_FROM

SEEDS = range(12)


@cache
def drawn(what: str, seed: int) -> Scenario:
    """A draw that several tests look at."""
    return draw_scenario(what, seed)


def route_of(scenario: Scenario) -> Route:
    return plan_route(load_network(scenario.network), scenario.missions[0])


@pytest.mark.parametrize("what", [*Manoeuvre, DRIVE])
def test_a_scenario_follows_from_its_seed_and_others_differ(what):
    first = [drawn(what, seed) for seed in SEEDS]
    assert first[:3] == [draw_scenario(what, seed) for seed in SEEDS[:3]]
    assert len({one.content_hash() for one in first}) == len(SEEDS)
    assert {one.time_limit_s for one in first} == {TIME_LIMITS_S[what]}
    held_out = draw_scenario(what, HELD_OUT_FROM)
    assert held_out.missions[0] not in [one.missions[0] for one in first]


@pytest.mark.parametrize("seed", SEEDS)
def test_no_start_is_too_fast_for_the_road_ahead(seed):
    for what in (Manoeuvre.LANE, Manoeuvre.BRAKING, Manoeuvre.LIGHTS):
        scenario = drawn(what, seed)
        speed = scenario.missions[0].start_speed_mps or 0.0
        assert speed <= careful_speed(route_of(scenario))


@pytest.mark.parametrize("seed", SEEDS)
def test_lights_have_a_light_ahead(seed):
    passages = route_of(drawn(Manoeuvre.LIGHTS, seed)).passages
    first = next(one for one in passages if one.signal >= 0)
    assert 5.0 < first.entry < 105.0


def test_lights_are_met_in_every_state():
    warmed = [drawn(Manoeuvre.LIGHTS, seed).traffic.warm_up_s for seed in range(20)]
    assert np.ptp(warmed) > 60.0


@pytest.mark.parametrize("seed", SEEDS)
def test_lanes_have_no_light_near_their_start(seed):
    for what in (Manoeuvre.LANE, Manoeuvre.BRAKING):
        passages = route_of(drawn(what, seed)).passages
        assert all(one.entry >= LIGHTLESS_M for one in passages if one.signal >= 0)


def test_braking_has_one_event_of_every_kind_or_traffic_to_give_way_to():
    period = len(BRAKING_EVENTS) + GIVING_WAY
    drawn = [draw_scenario(Manoeuvre.BRAKING, seed) for seed in range(period)]
    kinds = [event.kind for one in drawn for event in one.events]
    assert sorted(kinds) == sorted(str(one["kind"]) for one in BRAKING_EVENTS)
    assert sum(not one.events for one in drawn) == GIVING_WAY
    assert all(one.traffic.vehicles for one in drawn if not one.events)


@pytest.mark.parametrize("what", [Manoeuvre.LANE, Manoeuvre.BRAKING, Manoeuvre.LIGHTS])
def test_people_walk_where_cars_drive_and_some_drives_are_alone(what):
    traffic = [drawn(what, seed).traffic for seed in range(20)]
    assert all(one.pedestrians == 2 * one.vehicles for one in traffic)
    assert 2 <= sum(one.vehicles == 0 for one in traffic) <= 14


@pytest.mark.parametrize("what", CHANGES)
def test_changes_have_a_lane_beside_and_half_of_them_a_blocked_one(what):
    scenarios = [drawn(what, seed) for seed in range(40)]
    for scenario in scenarios:
        network = load_network(scenario.network)
        lane = network.lane_index[scenario.missions[0].start.lane]
        beside = network.lanes.left if what is Manoeuvre.LEFT else network.lanes.right
        assert beside[lane] >= 0
        assert not route_of(scenario).lane_changes
    assert 10 <= sum(bool(scenario.obstacles) for scenario in scenarios) <= 30


@pytest.mark.parametrize("what", CHANGES)
def test_the_lane_beside_a_blocked_one_is_free(what):
    scenario = next(one for seed in range(40) if (one := drawn(what, seed)).obstacles)
    env = DrivingEnv(scenario, ("path", "objects", "lanes"), "acceleration_steering", reward=None)
    try:
        observation = env.reset()[0]["ego"]
    finally:
        env.close()
    around = Surroundings(observation)
    blocking = [one for one in around.neighbours if one.within(-0.9, 0.9) and one.s_low > 0.0]
    assert 45.0 < blocking[0].s_low < 85.0
    course = Course()
    course.look(around)
    assert course.free(what, speed=8.0)
