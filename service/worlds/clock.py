"""Clock: when the ticks of a world may begin."""

from __future__ import annotations

from typing import Literal

from dohyo.sumo_networks.units import TICK_S

Pace = Literal["lockstep", "realtime"]


class Clock:
    """Pace of a world: as fast as its workers decide, or that of the wall clock.

    Attributes:
        pace: lockstep: a tick waits for all decisions; realtime: it begins when its time has come.
        speed: Simulated seconds per second of the wall clock, in real time.
        overruns: Ticks in real time that began later than the one after them should have.
    """

    def __init__(self, pace: Pace, speed: float) -> None:
        self.pace, self.speed, self.overruns = pace, speed, 0
        self._due: float | None = None

    @property
    def realtime(self) -> bool:
        """Whether the wall clock counts."""
        return self.pace == "realtime"

    def change(self, pace: Pace, speed: float) -> None:
        """Changes the pace, from now on."""
        self.pace, self.speed = pace, speed
        self.restart()

    def restart(self) -> None:
        """The world stood still, or waited for a first decision: its next tick may begin at once."""
        self._due = None

    def wait_s(self, now: float) -> float:
        """Time until the next tick may begin, s."""
        return 0.0 if self._due is None or not self.realtime else max(0.0, self._due - now)

    def begin(self, now: float) -> None:
        """A tick begins. A world that is too slow does not catch up: its later ticks have their full time."""
        period = TICK_S / self.speed
        due = now if self._due is None else self._due
        self.overruns += self.realtime and now > due + period
        self._due = due + period if now <= due + period else now + period
