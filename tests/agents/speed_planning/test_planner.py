from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pytest

from dohyo.agents.speed_planning.buffer import (
    CELLS,
    RELEASE_M,
    RuleBuffer,
    Squeeze,
    density_of_action,
    in_buffer,
    observation,
)
from dohyo.agents.speed_planning.fundamental_diagram import FREEWAY, FundamentalDiagram, Triangle
from dohyo.agents.speed_planning.planner import (
    ADVECTION_MPS,
    NO_PLAN_MPS,
    OFF_MAINLINE_MPS,
    PlannerConfig,
    SpeedPlan,
    SpeedPlanner,
    open_gap,
    targets,
)
from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.freeway.measure import Pings
from dohyo.sumo_networks.freeway.road import load_freeway

NOBODY = Pings(np.empty(0), np.empty(0, np.str_), np.empty(0), np.empty(0, np.int64), np.empty(0))
ROAD = load_freeway("freeway")
STEP_PLAN = SpeedPlan(100.0, np.repeat(np.arange(114.0)[None] / 4, 4, axis=0), np.zeros((4, 114)), 100.0)


@dataclass
class FixedDensity:
    asked: float
    seen: FloatArray | None = None
    length_m: float = 2400.0

    def density(self, profile: FloatArray, squeeze: Squeeze, diagram: FundamentalDiagram) -> FloatArray:
        self.seen, self.squeeze = profile, squeeze
        return np.asarray(self.asked)


def queue() -> FloatArray:
    """Segments 12 to 15 crawl before the bottleneck at 16."""
    speed = np.full(21, 28.0)
    speed[12:16] = 6.0
    return speed


def test_a_vehicle_reads_its_place_and_three_ahead() -> None:
    read = STEP_PLAN.at(np.array([2050.0]), np.array([2]), 100.0)
    assert read[0] == pytest.approx([20 / 4, 22 / 4, 25 / 4, 30 / 4])


def test_between_publications_the_plan_travels_upstream() -> None:
    fresh, aged = (STEP_PLAN.at(np.array([2010.0]), np.array([0]), 100.0 + age)[0, 0] for age in (0.0, 50.0))
    assert aged == pytest.approx(np.floor((2010 + ADVECTION_MPS * 50) / 100) / 4)
    assert aged > fresh


def test_off_the_mainline_and_before_the_first_plan() -> None:
    position, lane = np.array([np.nan, 500.0]), np.array([-1, 0])
    assert STEP_PLAN.at(position, lane, 100.0)[0] == pytest.approx([OFF_MAINLINE_MPS] * 4)
    assert targets(None, position, lane, 0.0)[:, 0].tolist() == [OFF_MAINLINE_MPS, NO_PLAN_MPS]


def test_a_gap_is_asked_for_where_the_target_falls() -> None:
    assert open_gap(np.array([[25.0, 25, 20, 20], [25, 25, 24, 10]])).tolist() == [True, False]


def test_without_a_feed_the_road_is_taken_for_free() -> None:
    plan = SpeedPlanner(ROAD, None).publish(0.0, None, NOBODY)
    assert (plan.target_mps == 30.0).all()


def test_unknown_segments_are_taken_for_free_and_known_ones_smoothed() -> None:
    speed = np.full(21, np.nan)
    speed[10] = 5.0
    plain, roomy = (
        SpeedPlanner(ROAD, None, PlannerConfig(kernel_m=1000.0, headroom=headroom)) for headroom in (1.0, 1.15)
    )
    plan = plain.publish(0.0, speed, NOBODY)
    assert plan.target_mps.min() == pytest.approx((5 * 5.5 + 30 * 4.5) / 10, abs=2.5)
    assert roomy.publish(0.0, speed, NOBODY).target_mps.min() == pytest.approx(1.15 * plan.target_mps.min())
    assert (plan.target_mps[:, :30] == 30.0).all()


def test_a_queue_that_stands_gets_a_buffer_before_it_and_the_target_is_the_lower() -> None:
    policy, found = FixedDensity(FREEWAY.density(np.array(4.0)).item()), PlannerConfig(bottleneck="found")
    planner, other = SpeedPlanner(ROAD, policy, found), SpeedPlanner(ROAD, None, found)
    plans = [planner.publish(60.0 * k, queue(), NOBODY) for k in range(5)]
    without = [other.publish(60.0 * k, queue(), NOBODY).target_mps for k in range(5)][-1]
    assert plans[0].bottleneck_m is None
    last = plans[-1]
    assert last.bottleneck_m == pytest.approx(ROAD.bottleneck_m, abs=400)
    assert last.bottleneck_m is not None
    assert last.buffer_mps == pytest.approx(4.0)
    inside = in_buffer(planner.grid.centres_m, last.bottleneck_m, policy.length_m)
    assert last.target_mps[:, inside] == pytest.approx(np.minimum(without[:, inside], 4.0))
    assert last.target_mps[:, ~inside] == pytest.approx(without[:, ~inside])


@pytest.mark.parametrize("length_m", [2400.0, 6000.0])
def test_before_a_known_bottleneck_there_is_a_buffer_from_the_first_publication(length_m: float) -> None:
    policy = FixedDensity(FREEWAY.density(np.array(12.0)).item(), length_m=length_m)
    plan = SpeedPlanner(ROAD, policy).publish(0.0, None, NOBODY)
    assert plan.bottleneck_m == ROAD.bottleneck_m
    slow = np.flatnonzero(plan.target_mps[0] < 29.0)
    assert plan.target_mps[:, slow] == pytest.approx(12.0)
    assert len(slow) * plan.cell_m == length_m
    assert (slow[-1] + 1) * plan.cell_m == pytest.approx(ROAD.bottleneck_m - RELEASE_M, abs=100)


def test_a_faster_buffer_than_the_state_changes_nothing() -> None:
    planner = SpeedPlanner(ROAD, FixedDensity(FREEWAY.critical_density))
    for k in range(5):
        plan = planner.publish(60.0 * k, queue(), NOBODY)
    without = SpeedPlanner(ROAD, None).publish(0.0, queue(), NOBODY)
    assert plan.target_mps == pytest.approx(without.target_mps)


def test_the_policy_sees_the_queue_dense_and_the_bottlenecks_lanes() -> None:
    policy = FixedDensity(0.05)
    planner = SpeedPlanner(ROAD, policy)
    for k in range(5):
        planner.publish(60.0 * k, queue(), NOBODY)
    assert policy.seen is not None
    assert policy.seen.shape == (CELLS,)
    assert policy.seen[17] == pytest.approx(float(FREEWAY.density(np.array(6.0))), rel=0.05)
    assert policy.squeeze == Squeeze(before=4, inside=3)


def test_the_rule_stores_more_minute_by_minute_while_it_is_too_dense_and_lets_go_again() -> None:
    rule = RuleBuffer()
    crowded = np.full(CELLS, float(FREEWAY.density(np.array(8.0))))
    free = np.full(CELLS, FREEWAY.critical_density)
    slower = [float(FREEWAY.speed(rule.density(crowded, Squeeze(4, 3), FREEWAY))) for _ in range(40)]
    assert slower[0] < 30.0
    assert all(after < before or after == pytest.approx(rule.slowest_mps) for before, after in pairwise(slower))
    assert slower[-1] == pytest.approx(rule.slowest_mps)
    faster = [float(FREEWAY.speed(rule.density(free, Squeeze(4, 3), FREEWAY))) for _ in range(80)]
    assert faster[0] < faster[1]
    assert faster[-1] == pytest.approx(30.0)


def test_the_rule_watches_only_the_last_stretch_before_the_bottleneck() -> None:
    profile = np.full(CELLS, float(FREEWAY.density(np.array(5.0))))
    profile[17:20] = float(FREEWAY.density(np.array(RuleBuffer().wanted_mps)))
    assert float(RuleBuffer().density(profile, Squeeze(4, 3), FREEWAY)) == pytest.approx(FREEWAY.critical_density)
    both = RuleBuffer().density(np.stack([profile, np.roll(profile, 5)]), Squeeze(4, 3), FREEWAY)
    assert both[0] == pytest.approx(FREEWAY.critical_density)
    assert both[1] > FREEWAY.critical_density


def test_actions_span_from_nothing_to_the_slowest_buffer() -> None:
    diagram = Triangle()
    density = density_of_action(np.array([-1.0, 1.0, 5.0]), diagram)
    assert diagram.speed(density) == pytest.approx([30.0, 4.0, 4.0])


def test_a_profile_of_another_length_is_refused() -> None:
    with pytest.raises(InvalidInputError, match="profile of 24 cells, got 7"):
        observation(np.zeros(7), Squeeze(4, 3), Triangle())
