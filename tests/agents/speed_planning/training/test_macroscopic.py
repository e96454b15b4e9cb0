from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dohyo.agents.speed_planning.fundamental_diagram import FundamentalDiagram, Greenshields, Triangle
from dohyo.agents.speed_planning.training.macroscopic import CellRoad, CellTraffic, advance, empty, speeds, vehicles
from dohyo.sumo_networks.errors import InvalidInputError

TRIANGLE = Triangle(free_speed_mps=30.0, wave_speed_mps=5.0, jam_density=0.14)  # tip at 0.02 veh/m, 0.6 veh/s


def road(lanes: list[int], **changes: Any) -> CellRoad:
    settings_: dict[str, Any] = {"cell_m": 150.0, "diagram": TRIANGLE, "drop": 0.0, "step_s": 5.0} | changes
    return CellRoad(lanes=np.array(lanes), bottleneck=int(np.argmin(lanes)) or 1, **settings_)


def run(road: CellRoad, traffic: CellTraffic, demand: float, steps: int, advised: float | None = None) -> Any:
    passed = []
    for _ in range(steps):
        told = None if advised is None else np.full(traffic.controlled_m.shape, advised)
        traffic, passage = advance(road, traffic, np.full(len(traffic.density), demand), told)
        passed.append(passage.discharged[0])
    return traffic, np.array(passed)


def test_a_lone_pulse_moves_one_cell_per_step_at_the_free_speed() -> None:
    lane = road([1] * 6)
    density = np.zeros((1, 6))
    density[0, 1] = 0.01
    traffic, _ = run(lane, CellTraffic(density, np.zeros(1), np.full((1, 0), np.nan)), 0.0, 3)
    assert np.flatnonzero(traffic.density[0]).tolist() == [4]


def test_a_queues_tail_travels_at_the_speed_of_the_shock() -> None:
    """Demand 0.5 veh/s meets a bottleneck of 0.6 on two lanes' worth: 0.8 arrives, 0.6 passes."""
    lanes = road([2] * 60 + [1] * 5)
    traffic, _ = run(lanes, empty(lanes, 1), 0.8, 120)
    tails = []
    for _ in range(2):
        per_lane = traffic.density[0, :60] / 2
        tails.append(np.argmax(per_lane > 0.03) * 150.0)
        traffic, _ = run(lanes, traffic, 0.8, 60)
    # Free: 0.4 veh/s and lane at 0.4/30 veh/m. Queue: 0.3 veh/s and lane at 0.14 - 0.3/5 = 0.08 veh/m.
    by_hand = (0.3 - 0.4) / (0.08 - 0.4 / 30)
    assert (tails[1] - tails[0]) / 300.0 == pytest.approx(by_hand, abs=150 / 300)
    assert np.median(traffic.density[0, 50:59] / 2) == pytest.approx(0.08, abs=1e-6)


def test_the_bottleneck_carries_its_capacity_and_less_once_a_queue_stands() -> None:
    for drop in (0.0, 0.2):
        lanes = road([2] * 20 + [1] * 5, drop=drop)
        _, passed = run(lanes, empty(lanes, 1), 1.0, 300)
        assert passed[-20:].mean() / lanes.step_s == pytest.approx(0.6 * (1 - drop), rel=1e-6)


def test_without_a_queue_nothing_is_dropped() -> None:
    lanes = road([2] * 20 + [1] * 5, drop=0.2)
    _, passed = run(lanes, empty(lanes, 1), 0.59, 300)
    assert passed[-20:].mean() / lanes.step_s == pytest.approx(0.59, rel=1e-6)


@pytest.mark.parametrize("diagram", [TRIANGLE, Greenshields(30.0, 0.14)])
def test_past_a_slow_vehicle_flows_what_the_pde_ode_says(diagram: FundamentalDiagram) -> None:
    """One controlled vehicle at 10 m/s on two lanes: alpha = 1/2, so 1 lane's passing flow + 10 rho."""
    lanes = road([2] * 10, diagram=diagram, cell_m=300.0)
    density = np.full((1, 10), 2 * diagram.critical_density)
    traffic = CellTraffic(density, np.zeros(1), np.array([[1300.0]]))
    after, _ = advance(lanes, traffic, np.array([2 * diagram.capacity]), np.array([[10.0]]))
    passing = float(diagram.passing_flow(np.array(10.0))) + 10.0 * density[0, 4]
    least = min(passing, 2 * diagram.capacity)
    assert after.density[0, 5] - density[0, 5] == pytest.approx((least - 2 * diagram.capacity) * 5.0 / 300.0, abs=1e-9)
    assert after.controlled_m[0, 0] == pytest.approx(1350.0)


def test_a_controlled_vehicle_is_no_faster_than_the_traffic_and_leaves_at_the_end() -> None:
    lanes = road([1] * 4)
    jam = CellTraffic(np.full((1, 4), 0.08), np.zeros(1), np.array([[100.0]]))
    after, _ = advance(lanes, jam, np.zeros(1), np.array([[30.0]]))
    assert after.controlled_m[0, 0] == pytest.approx(100.0 + 5.0 * float(speeds(lanes, jam)[0, 0]))
    gone, _ = run(lanes, CellTraffic(np.zeros((1, 4)), np.zeros(1), np.array([[590.0]])), 0.0, 2, advised=30.0)
    assert np.isnan(gone.controlled_m).all()


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 10_000), drop=st.floats(0.0, 0.5), advised=st.floats(0.0, 40.0))
def test_vehicles_are_conserved_and_never_too_dense(seed: int, drop: float, advised: float) -> None:
    rng = np.random.default_rng(seed)
    lanes = road([3] * 8 + [2] * 4, drop=drop)
    density = rng.uniform(0, TRIANGLE.jam_density, (4, 12)) * lanes.lanes
    traffic = CellTraffic(density, rng.uniform(0, 20, 4), rng.uniform(0, lanes.length_m, (4, 6)))
    for _ in range(15):
        demand = rng.uniform(0, 2, 4)
        before = vehicles(lanes, traffic)
        traffic, passage = advance(lanes, traffic, demand, np.full((4, 6), advised))
        assert vehicles(lanes, traffic) == pytest.approx(before + demand * lanes.step_s - passage.left, abs=1e-6)
        assert (traffic.density >= 0).all()
        assert (traffic.density <= TRIANGLE.jam_density * lanes.lanes + 1e-9).all()


@pytest.mark.parametrize(
    ("changes", "message"),
    [({"step_s": 6.0}, "stay within"), ({"drop": 1.0}, "capacity drop"), ({"bottleneck": 9}, "cell 1")],
)
def test_a_road_that_cannot_be_is_refused(changes: dict[str, Any], message: str) -> None:
    given_: dict[str, Any] = {
        "cell_m": 150.0,
        "diagram": TRIANGLE,
        "step_s": 5.0,
        "bottleneck": 3,
        "drop": 0.1,
    } | changes
    with pytest.raises(InvalidInputError, match=message):
        CellRoad(lanes=np.array([2] * 5), **given_)
