"""Deadlines: how long the calls of an agent that parks may take."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from typing import Final, Literal

from dohyo.evaluation.episode.deadline import deadline
from dohyo.evaluation.episode.guarded_agent import RESET_DEADLINE_S, WARM_UP_DEADLINE_S
from dohyo.evaluation.parking.agent import ParkingAgent

Call = Literal["reset", "act", "close"]
Limit = Callable[[Call, int, ParkingAgent], AbstractContextManager[None]]
"""Function that makes a context manager for a call of the agent of a kart, by the kart's number."""


def unlimited(call: Call, kart: int, agent: ParkingAgent) -> AbstractContextManager[None]:
    """The limit of agents that are watched elsewhere: none."""
    return nullcontext()


class Deadlines:
    """Deadlines of all calls in one process; an agent's first reset and decision may compile."""

    def __init__(self, act_s: float, watch: Callable[[float], None] = lambda seconds: None) -> None:
        """Stores the deadlines.

        Args:
            act_s: Wall-clock time allowed for one decision, s.
            watch: Function called with the deadline in seconds before every call of an agent, and with 0 after it.
        """
        self._seconds: Final = {"reset": RESET_DEADLINE_S, "act": act_s, "close": RESET_DEADLINE_S}
        self._watch, self._called = watch, set[tuple[Call, int]]()

    @contextmanager
    def limit(self, call: Call, kart: int, agent: ParkingAgent) -> Iterator[None]:
        """Limits the time of its block, a call of the agent of a kart.

        Raises:
            AgentTimeoutError: The time is over.
        """
        compiles = call != "close" and (call, kart) not in self._called
        seconds = WARM_UP_DEADLINE_S if compiles else self._seconds[call]
        self._called.add((call, kart))
        self._watch(seconds)
        try:
            with deadline(seconds, f"agent '{agent.spec.name}'"):
                yield
        finally:
            self._watch(0.0)
