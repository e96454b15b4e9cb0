from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.signal import savgol_filter  # type: ignore[import-untyped]

from dohyo.agents.experts.detour import Detour
from dohyo.agents.experts.idm import IdmPlanner
from dohyo.agents.experts.pdm import LINE_GAP_M, MODEL, PdmClosed, Variant
from dohyo.agents.experts.proposals import (
    COMFORT,
    DAC,
    DDC,
    EP,
    FACTORS,
    HEADING,
    MET_AT,
    NC,
    PROPOSALS,
    SCORES,
    SPEED,
    STATE,
    STEPS,
    TOTAL,
    TTC,
    S,
    roll_out,
    score,
)
from dohyo.agents.planning.motion import DT, Idm, body, boxes_meet, idm_acceleration, project
from dohyo.agents.planning.prediction import constant_velocity
from dohyo.agents.planning.scene import SceneBuilder
from dohyo.agents.planning.situation import JUNCTION_BIT, ROAD_BIT, ROUTE_BIT, Situation, leader, on_grid, situation
from dohyo.evaluation.agent import Agent
from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.ego.dynamics import VehicleParameters
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.world import LightState
from tests.agents.driving import drive, fronts, observed, speeds, touched
from tests.agents.mcts.roads import observation, straight
from tests.worlds import Scene, lit_crossing, straight_road

CAR = body(VehicleParameters(), 6.0)
HAND = Idm(gap=2.0, headway=1.5, acceleration=1.0, braking=4.0, exponent=4.0, least_gap=0.1, hardest=5.0)


@pytest.mark.parametrize(
    ("speed", "target", "gap", "leading", "expected"),
    [
        (0.0, 10.0, math.inf, 0.0, 1.0),  # a (1 - 0)
        (10.0, 10.0, math.inf, 0.0, 0.0),  # a (1 - 1)
        (5.0, 10.0, math.inf, 0.0, 1.0 - 0.5**4),
        (10.0, 20.0, 20.0, 10.0, 1.0 - 0.5**4 - (17.0 / 20.0) ** 2),  # s* = 2 + 15
        (10.0, 20.0, 84.0, 0.0, 1.0 - 0.5**4 - (42.0 / 84.0) ** 2),  # s* = 2 + 15 + 10 x 10 / (2 x 2)
        (10.0, 20.0, 20.0, 30.0, 1.0 - 0.5**4 - (2.0 / 20.0) ** 2),  # a leader that runs away: s* = 2
        (10.0, 20.0, 1.0, 0.0, -5.0),  # never harder than that
    ],
)
def test_idm_by_hand(speed: float, target: float, gap: float, leading: float, expected: float) -> None:
    assert idm_acceleration(HAND, speed, target, gap, leading) == pytest.approx(expected)


def test_the_leader_is_the_nearest_in_the_corridor() -> None:
    road = straight(cars=[(40.0, 0.0, 5.0), (20.0, 3.0, 9.0), (25.0, 1.5, 7.0), (-20.0, 0.0, 3.0)])
    gap, speed = leader(road, 2.25, 1.1, 0.0, 0.0, 0.0)
    assert (gap, speed) == (pytest.approx(25.0 - 4.5, abs=1e-3), pytest.approx(7.0, abs=1e-3))
    gap, speed = leader(road, 2.25, 1.1, 0.0, 2.0, 0.0)
    assert (gap, speed) == (pytest.approx(25.0 + 14.0 - 4.5, abs=1e-3), pytest.approx(7.0, abs=1e-3))
    assert leader(straight(), 2.25, 1.1, 0.0, 0.0, 0.0)[0] == math.inf


def test_the_grid_knows_road_and_route() -> None:
    road = straight(width=6.0)
    assert on_grid(road.grid, 10.0, 2.5) == ROAD_BIT | ROUTE_BIT
    assert on_grid(road.grid, 10.0, 4.5) == 0
    assert on_grid(road.grid, 10.0, 1000.0) == ROAD_BIT | ROUTE_BIT  # nothing is known out there


@pytest.mark.parametrize("light", [LightState.GREEN, LightState.RED])
def test_the_grid_knows_the_inside_of_a_junction(light: LightState) -> None:
    world = lit_crossing().with_ego(x=-40.0).with_lights(light).world()
    scene = SceneBuilder().update(observed(PdmClosed(), world))
    road = situation(scene, constant_velocity(scene), max_speed=14.0, curve=2.5, braking=2.0)
    ahead = [bool(on_grid(road.grid, float(x), 0.0) & JUNCTION_BIT) for x in (0.0, 40.0, 80.0)]
    assert ahead == [False, True, False]


def test_projection_goes_on_straight_past_both_ends() -> None:
    path = np.array([[0.0, 0.0, 1.0, 0.0], [1.0, 0.0, 1.0, 0.0], [2.0, 0.0, 1.0, 0.0]])
    assert project(path, 5.0, 1.0, 1.4, 0.3, 6.0, 9.0)[:2] == (pytest.approx(6.4), pytest.approx(0.3))
    assert project(path, 5.0, 1.0, 4.0, -1.0, 6.0, 9.0)[:2] == (pytest.approx(9.0), pytest.approx(-1.0))
    assert project(path, 5.0, 1.0, -2.0, 0.0, 6.0, 9.0)[0] == pytest.approx(3.0)


@pytest.mark.parametrize(("x", "meets"), [(4.4, True), (4.6, False)])
def test_boxes_meet_at_their_edges(x: float, meets: bool) -> None:
    assert boxes_meet(0.0, 0.0, 1.0, 0.0, 2.25, 0.9, x, 0.0, 1.0, 0.0, 2.25, 0.9) == meets


# PDM's proposals


def rolled(road: Situation, speed: float, careful: bool = True, leeway: float = 0.0) -> tuple[FloatArray, FloatArray]:
    start, states = np.zeros(STATE), np.zeros((PROPOSALS, STEPS + 1, STATE))
    start[0], start[SPEED] = -CAR.axle, speed
    scores = np.zeros((PROPOSALS, SCORES))
    roll_out(road, CAR, MODEL, LINE_GAP_M, 0.2, start, states, careful)
    score(road, CAR, states, scores, leeway)
    return states, scores


def test_there_are_fifteen_and_they_differ() -> None:
    states, _ = rolled(straight(), 6.0)
    ends = {(round(float(s), 2), round(float(y), 2)) for s, y in states[:, -1][:, [S, 8]]}
    assert len(ends) == PROPOSALS == 15


def test_no_proposal_brakes_for_a_leader_that_is_not_there() -> None:
    """The public version began with a row of zeros for a leader, so that every proposal braked at first."""
    states, _ = rolled(straight(), 6.0)
    assert states[4, 1, SPEED] > 6.0


def test_the_leader_is_known_from_the_first_step() -> None:
    states, _ = rolled(straight(cars=[(9.0, 0.0, 0.0)]), 6.0)
    assert (states[[4], 1, SPEED] < 6.0).all()


def test_no_proposal_drives_backwards() -> None:
    states, _ = rolled(straight(cars=[(7.0, 0.0, 0.0)]), 8.0)
    assert (states[:, :, SPEED] >= 0.0).all()


def test_proposals_share_no_state() -> None:
    road = straight(cars=[(30.0, 0.0, 2.0)])
    together, _ = rolled(road, 7.0)
    again, _ = rolled(road, 7.0)
    np.testing.assert_array_equal(together, again)
    np.testing.assert_array_equal(together[:, 0, :7], np.repeat(together[:1, 0, :7], PROPOSALS, axis=0))


def test_terms_on_a_free_road() -> None:
    states, scores = rolled(straight(limit=8.0), 7.0)
    assert (scores[:, [NC, DAC, DDC, TTC]] == 1.0).all()
    assert np.isinf(scores[:, MET_AT]).all()
    best = int(np.argmax(scores[:, EP]))
    assert best % len(FACTORS) == len(FACTORS) - 1
    expected = (5 * scores[:, EP] + 5 + 2 * scores[:, COMFORT]) / 12
    np.testing.assert_allclose(scores[:, TOTAL], expected)
    assert states[best, -1, HEADING] == pytest.approx(0.0, abs=0.05)


@pytest.mark.parametrize(("most", "ticks"), [(0.9, 4), (0.7, 4), (0.7, 1), (0.9, 12)])
def test_comfort_bounds_the_yaw_acceleration_as_nuplan_does(most: float, ticks: int) -> None:
    """From a curve to the right into one to the left, within some ticks around the 21st."""
    rates = most * np.clip((np.arange(STEPS) - 21.0) / (0.5 * ticks), -1.0, 1.0)
    states, scores = np.zeros((1, STEPS + 1, STATE)), np.zeros((1, SCORES))
    states[0, 1:, HEADING] = np.cumsum(rates * DT)
    score(straight(), CAR, states, scores, 0.0)
    largest = np.abs(savgol_filter(states[0, :, HEADING], 15, 3, deriv=2, delta=DT)).max()
    assert scores[0, COMFORT] == (largest <= 1.93)


def test_a_collision_is_worth_nothing_and_an_object_half() -> None:
    _, scores = rolled(straight(cars=[(6.5, 0.0, 0.0)]), 12.0)
    assert scores[4, NC] == 0.0
    assert scores[4, TOTAL] == 0.0
    assert scores[4, MET_AT] < 1.0
    _, scores = rolled(straight(cars=[(6.5, 0.0, 0.0)], kind="static"), 12.0)
    assert scores[4, NC] == 0.5


def test_leaving_the_road_is_worth_nothing() -> None:
    _, scores = rolled(straight(width=2.6), 8.0)
    assert scores[4, DAC] == 1.0
    assert scores[9, DAC] == scores[14, DAC] == 0.0


def crossed_by_a_car(y: float, junction: bool, x: float = 25.0) -> Situation:
    """A car at 16 m/s from the right, 25 m ahead."""
    seen = observation([(x, y, 16.0)], width=80.0)
    seen["objects"][0, 3] = math.pi / 2
    scene = SceneBuilder().update(seen)
    road = situation(scene, constant_velocity(scene), max_speed=14.0, curve=2.5, braking=2.0)
    return road._replace(grid=road.grid | (JUNCTION_BIT if junction else 0))


def test_with_leeway_who_almost_meets_another_meets_him() -> None:
    places = np.arange(-60.0, 0.0, 1.0)
    exact, careful = (
        {y for y in places.tolist() if rolled(crossed_by_a_car(y, True), 10.0, leeway=leeway)[1][4, NC] == 0.0}
        for leeway in (0.0, 0.2)
    )
    assert exact < careful
    assert 5 <= len(careful) - len(exact) <= 8, "0.2 s at 16 m/s, on both sides"


def test_in_a_junction_who_comes_from_the_side_counts_for_the_time_to_collision() -> None:
    """Outside, not who comes more than 30 degrees beside the heading."""
    places = np.arange(-60.0, 0.0, 1.0).tolist()
    open_road, junction = (
        {y for y in places if rolled(crossed_by_a_car(y, inside, x=2.0), 3.0)[1][4, TTC] == 0.0}
        for inside in (False, True)
    )
    assert open_road < junction


def test_the_time_to_collision_looks_from_the_rear_axle_of_the_present() -> None:
    """A car that would be hit at 10 m/s is ahead of the ego, though beside its box where the two would meet."""
    for y in np.arange(-60.0, 0.0, 1.0).tolist():
        _, scores = rolled(crossed_by_a_car(y, junction=False), 10.0)
        assert scores[4, TTC] == scores[4, NC]


def test_who_is_about_to_cross_is_waited_for() -> None:
    seen = observation([(35.0, -5.0, 1.5)], kind="pedestrian", width=4.0)
    seen["objects"][0, 3], seen["objects"][0, 5:7] = math.pi / 2, 0.5
    scene = SceneBuilder().update(seen)
    road = situation(scene, constant_velocity(scene), max_speed=14.0, curve=2.5, braking=2.0)
    yields, _ = rolled(road, 10.0)
    goes, _ = rolled(road, 10.0, careful=False)
    assert yields[4, 20, SPEED] < 9.0 < goes[4, 20, SPEED]
    too_late, _ = rolled(road, 14.0)  # 3 m/s^2 would not stop it before the crossing: it does not try
    assert too_late[4, 10, SPEED] > 12.5


class Passes(Detour):
    """Always on the way round something."""

    passing = True


def test_who_stands_in_the_way_round_is_braked_for_and_not_passed() -> None:
    """A metre to the left nobody stands, but while the ego passes something room was not judged there."""
    agent = PdmClosed(looks_ahead=False)
    agent._detour = Passes(CAR.length, CAR.width)
    assert agent.act(observation([(14.0, -1.6, 0.0)], speed=10.0)) == pytest.approx([-8.0, 0.0], abs=1e-6)


@pytest.mark.parametrize(("variant", "braking"), [("careful", 8.0), ("published", 3.0)])
def test_a_careful_one_brakes_hard_at_any_speed(variant: Variant, braking: float) -> None:
    agent = PdmClosed(variant=variant)
    assert agent.act(observation([(13.0, 0.0, 0.0)], speed=9.0))[0] == pytest.approx(-braking)


def test_the_published_emergency_brake_works_at_low_speed() -> None:
    agent = PdmClosed(variant="published")
    assert agent.act(observation([(6.5, 0.0, 0.0)], speed=4.9))[0] == pytest.approx(-4.05)


def test_an_unknown_variant_is_an_error() -> None:
    with pytest.raises(InvalidInputError, match="expected variant 'careful' or 'published', got 'bold'"):
        PdmClosed(variant="bold")  # type: ignore[arg-type]


# Drives


@pytest.fixture(params=[IdmPlanner, lambda: PdmClosed(passing=False)], ids=["idm", "pdm-closed"])
def agent(request: pytest.FixtureRequest) -> Agent:
    made: Agent = request.param()
    return made


def test_it_comes_up_to_the_limit(agent: Agent) -> None:
    worlds = drive(agent, straight_road().with_ego(x=50.0), 20.0)
    assert 11.5 < speeds(worlds)[-1] < 15.0
    assert max(abs(float(world.egos.lateral[0])) for world in worlds) < 0.5


def test_it_stops_behind_a_standing_car(agent: Agent) -> None:
    worlds = drive(agent, straight_road().with_ego(x=50.0, speed=10.0).with_actor(130.0), 20.0)
    assert not touched(worlds)
    assert 120.0 < fronts(worlds)[-1] < 127.75


def test_it_stops_at_red_and_goes_on_at_green(agent: Agent) -> None:
    scene = lit_crossing().with_ego(x=-70.0, speed=8.0)
    line = scene.stop_line("w_c_0")
    worlds = drive(agent, scene.with_lights(lambda t: LightState.RED if t < 12.0 else LightState.GREEN), 18.0)
    assert fronts(worlds)[110] <= line
    assert fronts(worlds)[110] > line - 3.0
    assert fronts(worlds)[-1] > line


def test_looking_ahead_keeps_the_time_to_collision() -> None:
    """A leader that brakes at 6 m/s^2 until it stands, 16 m before the ego."""
    scene = straight_road().with_ego(x=50.0, speed=12.0)
    scene = scene.with_actor(66.0 + 4.5, lambda t: min(max(12.0 - 6.0 * (t - 0.6), 0.0), 12.0))
    shortest = {}
    for looks_ahead in (True, False):
        worlds = drive(PdmClosed(looks_ahead=looks_ahead), scene, 6.0)
        gaps = [float(world.actors.position[0, 0]) - 4.5 - float(world.egos.position[0, 0]) for world in worlds]
        closing = [float(world.egos.speed[0] - world.actors.speed[0]) for world in worlds]
        shortest[looks_ahead] = min(gap / rate for gap, rate in zip(gaps, closing, strict=True) if rate > 0.01)
        assert not touched(worlds) or not looks_ahead
    assert shortest[True] > shortest[False] + 0.1


@pytest.mark.parametrize(
    "start",
    [
        straight_road().with_ego(x=50.0).with_actor(50.0),
        straight_road().with_ego(x=50.0, y=-25.0),
        straight_road().with_ego(x=50.0, y=-400.0, heading=2.0),
        straight_road().with_ego(x=50.0, speed=5.0, heading=math.pi),
    ],
)
def test_impossible_starts_give_an_action(agent: Agent, start: Scene) -> None:
    for world in drive(agent, start, 1.0):
        assert np.isfinite(world.egos.position).all()


def test_it_says_why(agent: Agent) -> None:
    drive(agent, straight_road().with_ego(x=50.0, speed=8.0).with_actor(80.0), 0.5)
    assert agent.explain()
