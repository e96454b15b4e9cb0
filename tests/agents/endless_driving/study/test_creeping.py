"""Creeping: who stands below 0.4 m/s drives as who stands."""

from __future__ import annotations

import pytest

from dohyo.agents.endless_driving.study.creeping import creeping, table


def test_a_smallest_target_changes_next_to_nothing_where_the_ego_stands_below_it() -> None:
    stands, below = creeping(0.0, 0.0, missions=1), creeping(0.3, 0.4, missions=1)
    assert below.episode_return.mean == pytest.approx(stands.episode_return.mean, rel=0.02)
    hasty = creeping(3.0, 0.4, missions=1)
    assert hasty.episode_return.mean != pytest.approx(stands.episode_return.mean, rel=0.02)
    assert table([stands, below]).count("\n") == 3
