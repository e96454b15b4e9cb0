"""Ceiling: the experts drive missions themselves, and worse where they are told to err."""

from __future__ import annotations

from dohyo.agents.endless_driving.study.ceiling import ceiling, table


def test_experts_drive_themselves() -> None:
    rules, hasty = ceiling("rules", lawful=True, noise=0.0, missions=1), ceiling("rules", True, 0.9, missions=1)
    assert rules.success.mean == 100.0
    assert rules.episode_return.mean is not None
    assert hasty.episode_return.mean is not None
    assert rules.episode_return.mean > hasty.episode_return.mean
    assert table([rules, hasty]).count("\n") == 3
