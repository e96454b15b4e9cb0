"""Lockstep: when the next tick of a world begins.

A tick begins once every seat has decided, and in real time once its time has come. A decision that is overdue is
repeated from the tick before, or costs the seat. For decisions, the time in which the service stands still is no time.
"""

from __future__ import annotations

import asyncio
import time

from dohyo.service.errors import ConflictError
from dohyo.service.simulating.actors import WorldActors
from dohyo.service.simulating.order import WorldRules
from dohyo.service.simulating.shown import Decided
from dohyo.service.workers.loop_clock import LoopClock
from dohyo.service.worlds.live.clock import Clock, ObeyedSteps, Pace
from dohyo.service.worlds.live.seat import Seat
from dohyo.service.worlds.live.seats import Seats
from dohyo.service.worlds.live.simulation import Simulation
from dohyo.service.worlds.model import WorldStatus


class Lockstep:
    """Begins the ticks of a world.

    Attributes:
        status: Status of the world.
        clock: Pace of its ticks.
        deadline_s: Time for one decision, s.
    """

    def __init__(
        self, simulation: Simulation, seats: Seats, actors: WorldActors, rules: WorldRules, loop: LoopClock
    ) -> None:
        """Begins in a world that waits for its drivers."""
        self._loop = loop
        self.status, self.clock, self.deadline_s = WorldStatus.WAITING, Clock(rules.pace, rules.speed), rules.deadline_s
        self._simulation, self._seats, self._actors, self._late = simulation, seats, actors, rules.late
        self._allowed, self._obeyed = 0, ObeyedSteps()
        self._timer: asyncio.TimerHandle | None = None

    @property
    def goes_on(self) -> bool:
        """Whether the world ticks whenever all have decided."""
        return (self.status is WorldStatus.RUNNING or self._allowed > 0) and bool(self._simulation.driving)

    @property
    def ends_alone(self) -> bool:
        """Whether the world goes on without seats, until the egos that nobody drives have ended their drives."""
        return self.goes_on and self._seats.drove_all

    def due(self) -> float:
        """When a decision is due whose observations are shown now, in the loop's monotonic time."""
        return self._loop.monotonic() + self.deadline_s

    # Control

    def resume(self) -> None:
        """Lets the world tick whenever all have decided; also before all egos have drivers."""
        if self.status is not WorldStatus.OVER:
            self.status = WorldStatus.RUNNING
        self._allowed = 0
        self.renew()
        self.advance()

    def pause(self) -> None:
        """Lets the world stand still after the present tick."""
        if self.status is not WorldStatus.OVER:
            self.status = WorldStatus.PAUSED
        self._allowed = 0

    def change_pace(self, pace: Pace, speed: float) -> None:
        """Changes the pace, from the present tick on."""
        self.clock.change(pace, speed)
        self.renew()
        self.advance()

    def allow(self, ticks: int, key: str | None = None) -> None:
        """Lets a paused world go on for so many ticks.

        Args:
            ticks: Number of ticks.
            key: Key of the request; a repetition with the same key has no effect.

        Raises:
            ConflictError: It is not paused.
            InvalidInputError: The key was used for another number of ticks.
        """
        if key is not None and self._obeyed.repeats(key, ticks):
            return
        if self.status is not WorldStatus.PAUSED:
            raise ConflictError(f"expected a paused world, this one is {self.status.value}")
        self._allowed += ticks
        if key is not None:
            self._obeyed.remember(key, ticks)
        self.renew()
        self.advance()

    def restart(self) -> None:
        """The world begins anew; one that is paused stays so, and forgets the ticks that it was allowed."""
        self._allowed = 0
        if self.status is WorldStatus.OVER:
            self.status = WorldStatus.RUNNING

    # Ticks

    def renew(self) -> None:
        """Decisions are due from now on: while a world stands still, nobody is late."""
        self.clock.restart()
        self._seats.renew(self.due())

    def advance(self) -> None:
        """Begins the next tick if nothing holds it."""
        if not self._simulation.is_shown or not self.goes_on or not self._may_begin():
            return
        self._allowed = max(0, self._allowed - 1)
        self.clock.begin(time.monotonic())
        self._simulation.begin_tick(Decided(self._seats.decisions(self._simulation.driving), self._actors.changed()))

    def _may_begin(self) -> bool:
        """Whether the decisions are there, or in real time the tick's time has come."""
        silent = self._seats.silent
        if not self.clock.realtime:
            # A world that its drivers have left stands still, and ends after its idle time.
            return not silent and bool(self._seats or self._allowed or self._seats.drove_all)
        if any(seat.last is None for seat in silent):
            self.clock.restart()  # a first decision is waited for
            return False
        if (wait_s := self.clock.wait_s(time.monotonic())) > 0.0:
            self._call_later(wait_s)
            return False
        for seat in silent:
            seat.repeat()
        return True

    def _call_later(self, wait_s: float) -> None:
        if self._timer is not None:
            self._timer.cancel()
        self._timer = asyncio.get_running_loop().call_later(wait_s, self.advance)

    def repeat_late(self, now: float) -> list[Seat]:
        """Repeats decisions that are overdue at a time of the loop; returns the seats that end instead."""
        if not self._simulation.is_shown:
            # A world that is slower than its pace is always at a tick.
            return [one for one in self._seats if self.clock.realtime and one.repeated and now > one.due]
        lost: list[Seat] = []
        for seat in [one for one in self._seats.silent if now > one.due]:
            if self._late == "repeat" and seat.last is not None and not self.clock.realtime:
                seat.repeat()
            else:
                lost.append(seat)
        return lost
