"""Judging of plans: the drives of an episode are separated, and perfect plans score 100."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dohyo.agents.mcts.predictors.dataset import Sample
from dohyo.agents.pdm_hybrid.study.plans_judged import constant_velocity, drives_of, judged
from tests.agents.mcts.predictors.scenes import sampled, scene


def moment(time_s: float, x: float, y: float, speed: float) -> Sample:
    """An ego that drives east at a constant speed; it was at x at the beginning."""
    now = sampled(scene(ego_speed=speed))
    return replace(now, scene=replace(now.scene, time=time_s, pose=np.array([x + speed * time_s, y, 0.0])))


def episode() -> list[Sample]:
    """Two egos that drive one behind the other, and one that ends early."""
    egos = ((0.0, 0.0, 6.0), (-3.0, 0.0, 6.0), (0.0, 30.0, 3.0))
    return [moment(0.5 * tick, *ego) for tick in range(5) for number, ego in enumerate(egos) if number < 2 or tick < 3]


def test_samples_are_separated_by_where_their_futures_begin() -> None:
    drives = drives_of(episode())
    assert [len(drive) for drive in drives] == [5, 5, 3]
    assert all(len({float(sample.scene.pose[1]) for sample in drive}) == 1 for drive in drives)


def test_plans_that_come_true_score_100() -> None:
    row = judged(drives_of(episode()), constant_velocity)
    assert row["open_loop_score"] == pytest.approx(100.0)
    assert row["ade_m"] == row["fde_8s_m"] == pytest.approx(0.0, abs=1e-4)
    assert (row["drives"], row["plans"]) == (3, 8)


def test_a_plan_that_stands_is_as_far_off_as_was_driven() -> None:
    row = judged(drives_of(episode()), lambda scene: np.zeros((16, 3)))
    assert row["fde_8s_m"] == pytest.approx((48.0 + 48.0 + 24.0) / 3)
    assert row["open_loop_score"] == 0.0
