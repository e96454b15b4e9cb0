"""Deadlines of foreign code: however short, what is late is the agent's fault, and nothing is raised afterwards."""

from __future__ import annotations

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
