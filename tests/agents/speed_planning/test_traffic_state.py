from __future__ import annotations

import numpy as np
import pytest

from dohyo.agents.speed_planning.traffic_state import LaneGrid, forward_kernel, fuse
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.freeway.measure import Pings
from dohyo.sumo_networks.freeway.road import load_freeway

GRID = LaneGrid(bounds_m=np.array([0.0, 500.0, 1100.0]), lanes=3, through=np.array([3, 2]))


def pings(*rows: tuple[float, str, float, int, float]) -> Pings:
    time_s, name, position, lane, speed = zip(*rows, strict=True)
    return Pings(np.array(time_s), np.array(name), np.array(position), np.array(lane), np.array(speed))


def test_a_segments_speed_is_spread_over_its_sub_segments_and_all_lanes() -> None:
    state = GRID.spread(np.array([10.0, 20.0]))
    assert state.shape == (3, 11)
    assert (state[:, :5] == 10).all()
    assert (state[:, 5:] == 20).all()
    with pytest.raises(InvalidInputError, match="speeds of 2 segments"):
        GRID.spread(np.ones(3))


def test_the_mean_over_lanes_is_of_lanes_that_are_there() -> None:
    state = np.array([[10.0] * 11, [20.0] * 11, [30.0] * 11])
    assert (GRID.across(state) == [20.0] * 5 + [15.0] * 6).all()


def test_a_queue_on_all_lanes_of_the_bottleneck_is_as_slow_in_the_mean() -> None:
    road = load_freeway()
    grid = LaneGrid.of(road)
    state = np.full((grid.lanes, grid.cells), 30.0)
    state[:3] = 5.0
    narrow = slice(int(road.bottleneck_m / grid.cell_m) + 1, int(road.bounds_m[18] / grid.cell_m))
    assert grid.across(state)[narrow] == pytest.approx(5.0)
    assert grid.across(state)[0] == pytest.approx((3 * 5.0 + 30.0) / 4)


def test_pings_overwrite_their_own_lane_and_sub_segment_alone() -> None:
    state = fuse(GRID, np.full((3, 11), 25.0), pings((100, "a", 340, 1, 8.0), (101, "a", 348, 1, 10.0)), time_s=110)
    assert state[1, 3] == pytest.approx(9.0)
    assert np.count_nonzero(state != 25.0) == 1


def test_vehicles_count_once_each_however_long_they_stay() -> None:
    slow = [(100 + k, "slow", 350.0, 0, 2.0) for k in range(9)]
    state = fuse(GRID, np.full((3, 11), 25.0), pings(*slow, (105, "fast", 350.0, 0, 20.0)), time_s=110)
    assert state[0, 3] == pytest.approx(11.0)


def test_old_pings_and_those_off_the_segments_say_nothing() -> None:
    before = np.full((3, 11), 25.0)
    out = pings(
        (40, "old", 350, 1, 1.0),
        (105, "approach", -20, 1, 1.0),
        (105, "gone", 1100, 1, 1.0),
        (105, "ramp", np.nan, -1, 1.0),
    )
    assert (fuse(GRID, before, out, time_s=110) == before).all()


def test_fusing_leaves_the_forecast_as_it_was() -> None:
    before = np.full((3, 11), 25.0)
    fuse(GRID, before, pings((100, "a", 340, 1, 8.0)), time_s=110)
    assert (before == 25.0).all()


def test_the_kernel_looks_forward_only() -> None:
    state = np.full(10, 30.0)
    state[6] = 0.0
    smooth = forward_kernel(state, width_m=300, cell_m=100)
    assert smooth == pytest.approx([30, 30, 30, 30, 20, 20, 20, 30, 30, 30])


def test_at_the_roads_end_the_kernel_averages_what_is_left() -> None:
    smooth = forward_kernel(np.array([[10.0, 20.0, 40.0]]), width_m=250, cell_m=100)
    assert smooth[0] == pytest.approx([15.0, 30.0, 40.0])
