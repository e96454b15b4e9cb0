"""Measurements on hand-made worlds: what is measured, what is missing, and how late it comes."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.freeway.measure import (
    NOISE_MPS,
    PingLog,
    SegmentFeed,
    SpaceTimeMap,
    reported_speeds,
    wave_speed,
)
from dohyo.sumo_networks.freeway.road import load_freeway
from tests.sumo_networks.freeway.worlds import world_of

ROAD = load_freeway()
SIX = 6 * 3600.0


# The world's own arithmetic


def test_the_leader_is_the_next_in_the_same_lane() -> None:
    world = world_of(SIX, [100.0, 140.0, 120.0, math.nan], [10, 20, 30, 5], lanes=[0, 0, 1, -1])
    assert world.leader.tolist() == [1, -1, -1, -1]
    assert world.gap_m[0] == 35.0  # 40 m between centres, 5 m of vehicles
    assert world.gap_m[1] == world.gap_m[2] == math.inf
    assert math.isnan(world.gap_m[3])
    assert world.leader_speed_mps[0] == 20
    assert np.isnan(world.leader_speed_mps[1:]).all()


@given(st.lists(st.tuples(st.floats(0, 11_000), st.integers(0, 3)), min_size=1, max_size=30))
def test_gaps_of_a_lane_and_its_vehicles_fill_it(places: list[tuple[float, int]]) -> None:
    world = world_of(SIX, [place for place, _ in places], [1.0] * len(places), lanes=[lane for _, lane in places])
    for lane in {lane for _, lane in places}:
        mine = world.lane == lane
        gaps = world.gap_m[mine & np.isfinite(world.gap_m)]
        assert gaps.sum() + 5.0 * len(gaps) == pytest.approx(np.ptp(world.position_m[mine]))


def test_segments_are_those_of_the_road() -> None:
    middles = (ROAD.bounds_m[1:] + ROAD.bounds_m[:-1]) / 2
    positions = [-100.0, *middles.tolist(), 11_900.0, math.nan]
    world = world_of(SIX, positions, [1.0] * len(positions))
    assert world.segment.tolist() == [-1, *range(21), -1, -1]


# The feed


def test_the_feed_reports_the_probes_of_a_minute_late_and_nobody_else() -> None:
    feed = SegmentFeed(ROAD, seed=0, lag_minutes=2)
    for second in range(121):  # two probes at 10 and 20 m/s, and somebody fast whom the feed must not see
        feed.observe(world_of(SIX + second, [100.0, 200.0, 300.0], [10, 20, 40], probes=[True, True, False]))
    assert feed.reported(SIX + 179)[0].tolist() == []
    minutes, speeds = feed.reported(SIX + 180)
    assert minutes.tolist() == [360]
    assert speeds.shape == (1, 21)
    assert speeds[0, 0] == pytest.approx(15, abs=4 * NOISE_MPS)
    assert np.isnan(speeds[0, 1:]).all()
    assert feed.reported(SIX + 240)[0].tolist() == [360, 361]


def test_a_probe_alone_for_seconds_is_no_measurement() -> None:
    feed = SegmentFeed(ROAD, seed=0, lag_minutes=0)
    for second in range(61):
        there = 100.0 if second < 3 else 5000.0
        feed.observe(world_of(SIX + second, [there], [30]))
    _, speeds = feed.reported(SIX + 60)
    assert math.isnan(speeds[0, 0])


def test_reports_have_noise_and_gaps_but_no_other_errors() -> None:
    true = np.full((1440, 21), 25.0)
    reported = reported_speeds(true, np.full_like(true, 100.0), np.random.default_rng(0))
    there = ~np.isnan(reported)
    assert 0.9 < there.mean() < 1.0
    assert np.std(reported[there] - 25.0) == pytest.approx(NOISE_MPS, rel=0.05)
    assert np.mean(reported[there]) == pytest.approx(25.0, abs=0.02)


def test_where_no_probe_was_there_is_no_speed() -> None:
    reported = reported_speeds(np.full((60, 3), np.nan), np.zeros((60, 3)), np.random.default_rng(0))
    assert np.isnan(reported).all()


@given(st.integers(0, 1000))
def test_the_same_generator_gives_the_same_report(seed: int) -> None:
    true = np.full((30, 4), 10.0)
    once, twice = (reported_speeds(true, true, np.random.default_rng(seed)) for _ in range(2))
    assert np.array_equal(once, twice, equal_nan=True)
    assert np.nanmin(once, initial=0.0) >= 0.0


def silences(reported: FloatArray) -> list[int]:
    """Lengths of the gaps of all segments, minutes; one that many segments have at the same time counts once."""
    gaps = set[tuple[int, int]]()
    for column in np.isnan(reported).T:
        edges = np.flatnonzero(np.diff(np.r_[False, column, False])).tolist()
        gaps.update(zip(edges[::2], edges[1::2], strict=True))
    return [end - begin for begin, end in gaps]


def test_outages_of_a_live_feed_are_as_many_and_as_long_as_those_of_recorded_days() -> None:
    days = 15
    feed = SegmentFeed(ROAD, seed=0, lag_minutes=0)
    middles = ((ROAD.bounds_m[1:] + ROAD.bounds_m[:-1]) / 2).tolist()
    for half in range(days * 2880 + 1):
        feed.observe(world_of(30.0 * half, middles, [25.0] * len(middles)))
    _, live = feed.reported(math.inf)
    true = np.full_like(live, 25.0)
    recorded = reported_speeds(true, np.full_like(true, 100.0), np.random.default_rng(0))
    assert len(live) == days * 1440
    for feed_of_days in (live, recorded):  # 191 gaps in the mean, with a deviation of 14; their mean deviates by 0.9
        assert len(silences(feed_of_days)) == pytest.approx(days * (21 * 0.6 + 0.15), rel=0.3)
        assert 8 < np.mean(silences(feed_of_days)) < 16


# Pings


def test_pings_come_once_a_second_from_connected_vehicles_on_the_mainline() -> None:
    log = PingLog(keep_s=10)
    for tick in range(41):
        world = world_of(
            SIX + tick / 2,
            [100.0 + tick, 50.0, math.nan],
            [2.0, 3.0, 4.0],
            lanes=[2, 1, -1],
            connected=[True, False, True],
        )
        log.observe(world)
    pings = log.pings()
    assert len(pings.time_s) == 10
    assert set(pings.name.tolist()) == {"v0"}
    assert np.diff(pings.time_s) == pytest.approx(1.0)
    assert pings.time_s[-1] == SIX + 20
    assert pings.position_m[-1] == 140.0
    assert set(pings.lane.tolist()) == {2}


def test_before_anybody_pinged_there_are_none() -> None:
    pings = PingLog().pings()
    assert [len(column) for column in (pings.time_s, pings.name, pings.position_m, pings.lane, pings.speed_mps)] == [
        0
    ] * 5


# Maps and waves


def test_the_map_means_all_vehicles_of_a_cell() -> None:
    grid = SpaceTimeMap(ROAD, SIX, 120, cell_s=60, cell_m=100)
    grid.observe(world_of(SIX, [10.0, 90.0, 110.0, -50.0], [10, 20, 30, 99], probes=[False] * 4))
    grid.observe(world_of(SIX + 59, [10.0], [30]))
    grid.observe(world_of(SIX + 500, [10.0], [99]))
    speed = grid.speed_mps()
    assert speed.shape == (2, 115)
    assert speed[0, :2].tolist() == [20.0, 30.0]
    assert np.isnan(speed[1]).all()


@pytest.mark.parametrize("kmh", [-12.0, -16.0, -20.0])
def test_the_speed_of_a_drawn_wave_is_found(kmh: float) -> None:
    time, space = np.meshgrid(np.arange(0, 3600, 10.0), np.arange(0, 6000, 100.0), indexing="ij")
    rng = np.random.default_rng(0)
    waves = 12 + 8 * np.sin(2 * np.pi * (time - space / (kmh / 3.6)) / 400) + rng.normal(0, 2, time.shape)
    waves[rng.random(waves.shape) < 0.05] = np.nan
    assert 3.6 * wave_speed(waves, 10, 100) == pytest.approx(kmh, rel=0.06)


def drawn_waves() -> FloatArray:
    """(240, 60) waves of -16 km/h in cells of 15 s and 100 m."""
    time, space = np.meshgrid(np.arange(0, 3600, 15.0), np.arange(0, 6000, 100.0), indexing="ij")
    return np.asarray(12 + 6 * np.sin(2 * np.pi * (time + space / 4.44) / 400))


@pytest.mark.filterwarnings("error")
def test_places_without_measurements_are_left_out() -> None:
    waves = drawn_waves()
    waves[:, [30, 41]] = np.nan
    assert 3.6 * wave_speed(waves, 15, 100) == pytest.approx(-16, rel=0.06)


@pytest.mark.parametrize(
    ("rows", "columns", "cell_s", "cell_m", "said"),
    [
        (240, 60, 2000, 100, "finer cells"),
        (240, 60, 15, 3000, "finer cells"),
        (240, 10, 15, 100, "more than 32 times and 10 places, as the cells are, got 240 and 10"),
        (32, 60, 15, 100, "more than 32 times and 10 places, as the cells are, got 32 and 60"),
    ],
)
def test_maps_that_are_too_short_or_too_coarse_are_refused(
    rows: int, columns: int, cell_s: float, cell_m: float, said: str
) -> None:
    with pytest.raises(InvalidInputError, match=said):
        wave_speed(drawn_waves()[:rows, :columns], cell_s, cell_m)


def test_a_map_without_two_measured_places_apart_is_refused() -> None:
    waves = drawn_waves()
    waves[:, :50] = np.nan
    with pytest.raises(InvalidInputError, match="two measured places 10 cells apart, got none"):
        wave_speed(waves, 15, 100)


def test_noise_is_no_wave() -> None:
    assert math.isnan(wave_speed(np.random.default_rng(0).normal(20, 5, (360, 60)), 10, 100))
