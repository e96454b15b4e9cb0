"""Which option runs, tick by tick."""

from __future__ import annotations

import numpy as np
import pytest

from dohyo.agents.hierarchical.options.executor import OptionExecutor, OptionLimits, OptionView
from dohyo.agents.hierarchical.options.manoeuvres import Manoeuvre
from dohyo.agents.hierarchical.state.master_observation import OPTIONS

LANE, LIGHTS = OPTIONS.index(Manoeuvre.LANE), OPTIONS.index(Manoeuvre.LIGHTS)
TEMPO = OptionLimits(least_ticks=5, most_ticks=20)


def prospect(
    best: int = LANE, beta: float = 0.0, lit: bool = True, finished: bool = False, critical: bool = False
) -> OptionView:
    q = np.zeros(len(OPTIONS), np.float32)
    q[best] = 1.0
    available = np.ones(len(OPTIONS), np.bool_)
    available[LIGHTS] = lit
    return OptionView(q, np.full(len(OPTIONS), beta, np.float32), available, finished, critical)


def running(option: int = LANE, ticks: int = 0) -> OptionExecutor:
    conductor = OptionExecutor(TEMPO)
    conductor.begin(prospect(best=option))
    for _ in range(ticks):
        conductor.tick()
    return conductor


def test_at_first_there_is_none():
    conductor = OptionExecutor(TEMPO)
    assert conductor.option is None
    assert conductor.ends(prospect(), 0.5)


@pytest.mark.parametrize(
    ("ticks", "draw", "ends"), [(4, 0.0, False), (5, 0.0, True), (5, 0.7, False), (20, 0.99, True)]
)
def test_beta_is_asked_between_the_least_and_the_most(ticks, draw, ends):
    assert running(ticks=ticks).ends(prospect(beta=0.6), draw) is ends


def test_what_is_finished_ends_at_once():
    assert running(ticks=1).ends(prospect(finished=True), 0.99)


def test_lights_end_where_there_is_none_any_more():
    assert not running(LIGHTS, 1).ends(prospect(lit=True), 0.99)
    assert running(LIGHTS, 1).ends(prospect(lit=False), 0.99)
    assert not running(LANE, 1).ends(prospect(lit=False), 0.99)


def test_an_option_ends_where_it_may_not_begin_but_a_change_is_carried_out():
    closed = OptionView(np.zeros(len(OPTIONS)), np.zeros(len(OPTIONS)), np.eye(len(OPTIONS))[LIGHTS] > 0, False, False)
    assert running(LANE, 1).ends(closed, 0.99)
    assert not running(OPTIONS.index(Manoeuvre.LEFT), 1).ends(closed, 0.99)


def test_while_the_rules_drive_nothing_ends_and_after_them_the_master_chooses_anew():
    conductor = running(ticks=10)
    for _ in range(40):
        assert not conductor.ends(prospect(beta=1.0, finished=True, critical=True), 0.0)
        conductor.tick()
    assert conductor.ends(prospect(beta=0.0), 0.99)
    conductor.begin(prospect())
    assert not conductor.ends(prospect(beta=0.0), 0.99)
