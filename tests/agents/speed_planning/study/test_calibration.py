from __future__ import annotations

import numpy as np
import pytest

from dohyo.agents.speed_planning.fundamental_diagram import Triangle
from dohyo.agents.speed_planning.study.calibration import (
    CELL_M,
    FROM_M,
    LAST_M,
    MorningGrid,
    Surveyor,
    diagram,
    discharge,
)
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.freeway.road import load_freeway
from dohyo.sumo_networks.freeway.world import FreewayWorld

ROAD = load_freeway("freeway")


def world(time_s: float, position_m: list[float], speed_mps: float, lane: int = 0) -> FreewayWorld:
    n = len(position_m)
    no, zero = np.zeros(n, dtype=np.bool_), np.zeros(n)
    return FreewayWorld(
        road=ROAD, time_s=time_s, names=tuple(f"v{k}" for k in range(n)), position_m=np.array(position_m),
        lane=np.full(n, lane, dtype=np.int64), speed_mps=np.full(n, speed_mps), acceleration_mps2=zero,
        length_m=np.full(n, 5.0), connected=no, probe=no, vtype=np.zeros(n, dtype=np.int64), fuel_mg_s=zero,
    )  # fmt: skip


def test_a_minute_of_two_cars_in_one_cell_by_hand() -> None:
    surveyor = Surveyor(ROAD, 100.0, minutes=2)
    for second in range(60):
        surveyor.observe(world(100.0 + second, [FROM_M + 10, FROM_M + CELL_M - 10], 12.0))
    found = surveyor.survey()
    assert found.density[0, 0] == pytest.approx(2 / CELL_M / 4)  # four lanes
    assert found.speed_mps[0, 0] == pytest.approx(12.0)
    assert np.isnan(found.speed_mps[0, 1])
    assert found.passed.tolist() == [0, 0]


def test_who_passes_the_bottleneck_and_how_fast_it_was_before_it() -> None:
    surveyor, at = Surveyor(ROAD, 0.0, minutes=1), ROAD.bottleneck_m
    surveyor.observe(world(10.0, [at - 5, at - LAST_M + 1, at - LAST_M - 1], 8.0))
    surveyor.observe(world(11.0, [at + 3, at - LAST_M + 9, at - LAST_M + 7], 8.0))
    found = surveyor.survey()
    assert found.passed.tolist() == [1]
    assert found.last_mps.tolist() == [8.0]


def test_auxiliary_lanes_and_other_times_do_not_count() -> None:
    surveyor = Surveyor(ROAD, 100.0, minutes=1)
    surveyor.observe(world(130.0, [FROM_M + 10], 12.0, lane=4))
    surveyor.observe(world(99.0, [FROM_M + 10], 12.0))
    surveyor.observe(world(160.0, [FROM_M + 10], 12.0))
    assert surveyor.survey().density.sum() == 0


def test_the_diagram_that_made_a_morning_is_found() -> None:
    truth = Triangle(30.0, 4.0, 0.115)
    density = np.linspace(0.002, 0.1, 400).reshape(20, 20)
    found = diagram([MorningGrid(density, truth.speed(density), np.ones(20), np.ones(20))])
    assert found.free_speed_mps == pytest.approx(30.0, rel=0.02)
    assert found.wave_speed_mps == pytest.approx(4.0, rel=0.05)
    assert found.jam_density == pytest.approx(0.115, rel=0.05)
    with pytest.raises(InvalidInputError, match="congested"):
        diagram([MorningGrid(density / 100, np.full((20, 20), 30.0), np.ones(20), np.ones(20))])


def test_a_capacity_drop_shows_in_what_passes_at_low_speed() -> None:
    speed = np.array([24.0] * 20 + [8.0] * 20)
    passed = np.array([100.0] * 20 + [75.0] * 20)
    rows = discharge([MorningGrid(np.zeros((40, 1)), np.zeros((40, 1)), speed, passed)], demanded=5)
    assert rows[5, :2].tolist() == pytest.approx([15, 5950], rel=0.01)  # 22 to 26 m/s; the last two see the drop ahead
    assert rows[1].tolist() == pytest.approx([18, 4500, 0])
    assert np.isnan(rows[3, 1])
