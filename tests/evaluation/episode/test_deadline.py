"""Deadlines of foreign code: however short, what is late is the agent's fault, and nothing is raised afterwards."""

from __future__ import annotations

import random
import signal
import time

import pytest

from dohyo.evaluation.episode.deadline import deadline
from dohyo.sumo_networks.errors import AgentTimeoutError


@pytest.mark.parametrize("seconds", [1e-9, 1e-6, 2e-6, 5e-6, 1e-5, 2e-5, 1e-4])
def test_a_deadline_that_is_over_at_once_is_the_agents_fault(seconds: float) -> None:
    before = signal.getsignal(signal.SIGALRM)
    for _ in range(300):
        try:
            with deadline(seconds, "agent"):
                pass
        except AgentTimeoutError:
            pass
    with pytest.raises(AgentTimeoutError, match="agent took longer than"), deadline(seconds, "agent"):
        time.sleep(0.05)
    assert signal.getsignal(signal.SIGALRM) is before
    assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)


def test_what_ends_just_at_its_deadline_leaves_no_timer_behind() -> None:
    rng = random.Random(0)
    late = 0
    for _ in range(5000):
        ends, seconds = time.perf_counter() + rng.uniform(0.0, 3e-4), rng.uniform(1e-6, 3e-4)
        try:
            with deadline(seconds, "agent"):
                while time.perf_counter() < ends:
                    sum(range(50))
        except AgentTimeoutError:
            late += 1
        assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)
    assert 0 < late < 5000
