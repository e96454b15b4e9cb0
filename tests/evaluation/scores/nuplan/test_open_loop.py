"""The open-loop score: by hand, and what must not change it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dohyo.evaluation.scores.nuplan.open_loop import open_loop_score
from dohyo.sumo_networks.errors import InvalidInputError


def straight(plans: int, speed: float = 5.0) -> np.ndarray:
    """(plans, 8, 3) a straight line at a constant speed."""
    poses = np.zeros((plans, 8, 3))
    poses[:, :, 0] = speed * np.arange(1, 9)
    return poses


def beside(plans: int, metres: float = 0.0, radians: float = 0.0) -> np.ndarray:
    return straight(plans) + np.array([0.0, metres, radians])


def test_plans_that_come_true_score_100_and_bounds_are_reached_linearly() -> None:
    driven = straight(4)
    assert open_loop_score(driven, driven) == pytest.approx(100.0)
    assert open_loop_score(beside(4, metres=2.0), driven) == pytest.approx(100.0 * (2 * 0.75 + 4) / 6)
    assert open_loop_score(beside(4, radians=0.4), driven) == pytest.approx(100.0 * (2 + 4 * 0.5) / 6)
    assert open_loop_score(beside(4, radians=-1.2), driven) == pytest.approx(100.0 * 2 / 6)


def test_horizons_of_3_5_and_8_seconds_count_alike() -> None:
    planned, driven = straight(1), straight(1)
    planned[0, 7, 1] = 7.2  # after 8 s alone: a final error of (0, 0, 7.2), a mean one of (0, 0, 0.9)
    assert open_loop_score(planned, driven) == pytest.approx(100.0 * ((1 - 0.3 / 8) + (1 - 2.4 / 8) + 4) / 6)


@pytest.mark.parametrize(
    ("second", "metres", "missed"),
    [(3, 5.9, False), (3, 6.1, True), (5, 7.9, False), (5, 8.1, True), (8, 15.9, False), (8, 16.1, True)],
)
def test_a_miss_is_farther_than_6_m_within_3_s_8_within_5_and_16_within_8(
    second: int, metres: float, missed: bool
) -> None:
    planned, driven = straight(1), straight(1)
    planned[0, second - 1, 1] = metres
    assert (open_loop_score(planned, driven) == 0.0) is missed


@pytest.mark.parametrize(("wrong", "missed"), [(3, False), (4, True)])
def test_more_than_three_of_ten_misses_score_0(wrong: int, missed: bool) -> None:
    planned, driven = straight(10), straight(10)
    planned[:wrong, :, 1] = 20.0
    assert (open_loop_score(planned, driven) == 0.0) is missed


@given(angle=st.floats(-3.0, 3.0), x=st.floats(-1e3, 1e3), seed=st.integers(0, 1000))
def test_where_the_drive_is_seen_from_changes_nothing(angle: float, x: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    driven = straight(3)
    planned = driven + rng.normal(size=driven.shape) * (1.0, 1.0, 0.1)

    def seen(poses: np.ndarray) -> np.ndarray:
        cos, sin = np.cos(angle), np.sin(angle)
        east, north, heading = np.moveaxis(poses, -1, 0)
        return np.stack([x + east * cos - north * sin, east * sin + north * cos, heading + angle], axis=-1)

    assert open_loop_score(seen(planned), seen(driven)) == pytest.approx(open_loop_score(planned, driven))


@pytest.mark.parametrize("shape", [(0, 8, 3), (2, 7, 3), (2, 8, 2)])
def test_other_shapes_are_refused(shape: tuple[int, ...]) -> None:
    with pytest.raises(InvalidInputError, match=r"expected plans and drives of \(T, 8, 3\)"):
        open_loop_score(np.zeros(shape), np.zeros(shape))


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_plan_that_is_not_finite_has_no_score(value: float) -> None:
    planned = straight(4)
    planned[2, 5, 0] = value
    with pytest.raises(InvalidInputError, match="expected finite plans, got NaN or infinity at 2 s"):
        open_loop_score(planned, straight(4))
    with pytest.raises(InvalidInputError, match="expected finite drives"):
        open_loop_score(straight(4), planned)
