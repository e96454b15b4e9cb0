"""Creeping: who stands below 0.4 m/s drives as who stands."""

from __future__ import annotations

from dohyo.agents.endless_driving.study.creeping import creeping, table


def test_a_smallest_target_changes_nothing_where_the_ego_stands_below_it() -> None:
    stands, below = creeping(0.0, 0.0, missions=1), creeping(0.3, 0.4, missions=1)
    assert stands.episode_return == below.episode_return
    assert creeping(3.0, 0.4, missions=1).episode_return.mean != stands.episode_return.mean
    assert table([stands, below]).count("\n") == 3
