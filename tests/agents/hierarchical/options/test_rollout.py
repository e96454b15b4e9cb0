"""What an option teaches once it has ended, by hand."""

from __future__ import annotations

import numpy as np
import pytest

from dohyo.agents.hierarchical.options.executor import OptionExecutor, OptionLimits
from dohyo.agents.hierarchical.options.manoeuvres import Manoeuvre
from dohyo.agents.hierarchical.options.rollout import OptionRollout
from dohyo.agents.hierarchical.state.master_observation import OPTIONS

REWARDS = (1.0, 0.0, 4.0)


def trail(option: Manoeuvre, ruled: int | None = None) -> OptionRollout:
    made = OptionRollout(OptionExecutor(OptionLimits()))
    made.executor.option = OPTIONS.index(option)
    for tick, reward in enumerate(REWARDS):
        made.add(None if tick == ruled else np.full(2, tick, np.float32), reward)
    return made


def test_every_state_on_the_way_is_a_sample():
    samples = list(trail(Manoeuvre.LANE).samples(0.5))
    assert [int(one.state[0]) for one in samples] == [2, 1, 0]
    assert [one.ticks for one in samples] == [1, 2, 3]
    assert [one.total for one in samples] == pytest.approx([4.0, 2.0, 2.0])


def test_a_change_is_one_from_where_it_began_alone():
    (sample,) = trail(Manoeuvre.LEFT).samples(0.5)
    assert (int(sample.state[0]), sample.ticks, sample.total) == (0, 3, 2.0)


def test_a_tick_that_the_rules_drove_counts_but_begins_nothing():
    samples = list(trail(Manoeuvre.LANE, ruled=1).samples(0.5))
    assert [(int(one.state[0]), one.ticks) for one in samples] == [(2, 1), (0, 3)]
    assert samples[-1].total == pytest.approx(2.0)
