"""Clock: when the ticks of a world may begin, and requests for ticks that are sent twice."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final, Literal

from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.units import TICK_S

Pace = Literal["lockstep", "realtime"]
MOST_KEYS: Final = 1000
"""Number of requests that a world remembers; the oldest is forgotten first."""


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


@dataclass(slots=True)
class ObeyedSteps:
    """Requests for ticks that a paused world has obeyed, by key, so that a repetition has no effect."""

    _ticks: dict[str, int] = field(default_factory=dict)

    def repeats(self, key: str, ticks: int) -> bool:
        """Whether a request for so many ticks has been obeyed under a key.

        Raises:
            InvalidInputError: The key was used for another number of ticks.
        """
        before = self._ticks.get(key)
        if before not in (None, ticks):
            raise InvalidInputError("Idempotency-Key: this key was used for another request")
        return before is not None

    def remember(self, key: str, ticks: int) -> None:
        """Notes that a request was obeyed."""
        self._ticks[key] = ticks
        if len(self._ticks) > MOST_KEYS:
            del self._ticks[next(iter(self._ticks))]
