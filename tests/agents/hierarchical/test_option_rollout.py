"""What an option teaches once it has ended, by hand."""

from __future__ import annotations

import numpy as np
import pytest

from dohyo.agents.hierarchical.manoeuvres import Manoeuvre
from dohyo.agents.hierarchical.master_observation import OPTIONS
from dohyo.agents.hierarchical.option_executor import OptionExecutor, OptionLimits
from dohyo.agents.hierarchical.option_rollout import OptionRollout

REWARDS = (1.0, 0.0, 4.0)


def trail(option: Manoeuvre, ruled: int | None = None) -> OptionRollout:
    made = OptionRollout(OptionExecutor(OptionLimits()))
    made.conductor.option = OPTIONS.index(option)
    for tick, reward in enumerate(REWARDS):
        made.add(None if tick == ruled else np.full(2, tick, np.float32), reward)
    return made


def test_every_state_on_the_way_is_a_lesson():
    lessons = list(trail(Manoeuvre.LANE).lessons(0.5))
    assert [int(one.state[0]) for one in lessons] == [2, 1, 0]
    assert [one.ticks for one in lessons] == [1, 2, 3]
    assert [one.total for one in lessons] == pytest.approx([4.0, 2.0, 2.0])


def test_a_change_is_one_from_where_it_began_alone():
    (lesson,) = trail(Manoeuvre.LEFT).lessons(0.5)
    assert (int(lesson.state[0]), lesson.ticks, lesson.total) == (0, 3, 2.0)


def test_a_tick_that_the_rules_drove_counts_but_begins_nothing():
    lessons = list(trail(Manoeuvre.LANE, ruled=1).lessons(0.5))
    assert [(int(one.state[0]), one.ticks) for one in lessons] == [(2, 1), (0, 3)]
    assert lessons[-1].total == pytest.approx(2.0)


def test_it_goes_on_where_it_was():
    one, other = trail(Manoeuvre.LANE, ruled=0), OptionRollout(OptionExecutor(OptionLimits()))
    other.restore(one.state())
    assert [(a.ticks, a.total) for a in other.lessons(0.9)] == [(a.ticks, a.total) for a in one.lessons(0.9)]
    assert other.conductor.state() == one.conductor.state()
    empty = OptionRollout(OptionExecutor(OptionLimits()))
    empty.restore(OptionRollout(OptionExecutor(OptionLimits())).state())
    assert list(empty.lessons(0.9)) == []
