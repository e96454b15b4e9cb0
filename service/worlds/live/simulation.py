"""Simulation: the process of a live world, as the server sees it.

The process shows each tick again after a change of drivers, with the number of the change, so that no decision meets a
tick that was shown before the change.
"""

from __future__ import annotations

import asyncio
import json
from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

import msgspec

from dohyo.evaluation.agent import AgentSpec
from dohyo.service.errors import BusyError
from dohyo.service.running.channel import Fault, Kind
from dohyo.service.running.process import End, EpisodeProcess, Outcome
from dohyo.service.simulating.order import Drivers, Reset
from dohyo.service.simulating.shown import SHOWN, Decided, Shown

SHOW_S: Final = 120.0


class News(NamedTuple):
    """What a shown tick is.

    Attributes:
        first: Whether it is the first one of the process.
        restarted: Whether it is the first one since a reset.
        ticked: Whether it is another tick than the last one that was shown.
    """

    first: bool
    restarted: bool
    ticked: bool


class Simulation:
    """The process of a world, and the tick that it has shown last.

    Attributes:
        begun: Whether its first tick was shown.
        tick: Tick last shown.
        time_s: Simulated time of the tick, s.
        driving: Egos that still drive.
        shown: All else that was shown of the tick.
        seed: Seed of the present run.
        resets: How often it was told to begin anew.
        shown_resets: The same at the tick last shown.
        restarting: Whether it was told to begin anew, and has not shown its first tick yet.
        revision: Number of the last change of drivers.
    """

    def __init__(self, process: EpisodeProcess, egos: Sequence[str], seed: int) -> None:
        """Begins with a process that has shown nothing."""
        self._process = process
        self.begun, self.tick, self.time_s = False, 0, 0.0
        self.driving, self.shown = tuple(egos), Shown([], {}, {})
        self.seed, self.resets, self.shown_resets = seed, 0, 0
        self.restarting, self.revision = False, 0
        self._is_shown = asyncio.Event()

    @property
    def is_shown(self) -> bool:
        """Whether the tick with the present drivers is shown, and the process waits."""
        return self._is_shown.is_set()

    async def wait(self) -> None:
        """Waits until the present tick is shown.

        Raises:
            BusyError: The simulation takes too long.
        """
        try:
            await asyncio.wait_for(self._is_shown.wait(), SHOW_S)
        except TimeoutError:
            raise BusyError(f"the simulation took longer than {SHOW_S:g} s for one tick", retry_s=5) from None

    def check_begun(self) -> None:
        """Refuses what the process would take for its order.

        Raises:
            BusyError: The world has not begun yet.
        """
        if not self.begun:
            raise BusyError("the world has not begun yet", retry_s=1)

    def take(self, payload: bytes) -> News | None:
        """Takes a tick that the process shows; None: it will be shown again, with the present drivers."""
        tick, time_s, revision = SHOWN.unpack_from(payload)
        if revision != self.revision:
            return None
        news = News(not self.begun, self.restarting, tick > self.tick or self.restarting)
        self.shown = msgspec.msgpack.decode(memoryview(payload)[SHOWN.size :], type=Shown)
        self.begun, self.restarting, self.shown_resets = True, False, self.resets
        self.tick, self.time_s, self.driving = tick, time_s, tuple(self.shown.driving)
        self._is_shown.set()
        return news

    def change_drivers(self, specs: Mapping[str, AgentSpec | None], *, coupled: bool) -> None:
        """Changes drivers of egos (None: nobody drives one now); the tick is shown again."""
        self.revision += 1
        self._is_shown.clear()
        drivers = Drivers(revision=self.revision, specs=dict(specs), coupled=coupled)
        self._process.send(Kind.DRIVERS, drivers.model_dump_json().encode())

    def restart(self, seed: int | None) -> None:
        """Begins anew at tick 0 with the same drivers; None: with the same seed."""
        self.seed = self.seed if seed is None else seed
        self.resets, self.revision, self.restarting = self.resets + 1, self.revision + 1, True
        self._is_shown.clear()
        self._process.send(Kind.RESET, Reset(revision=self.revision, seed=self.seed).model_dump_json().encode())

    def begin_tick(self, decided: Decided) -> None:
        """Lets the process simulate the next tick."""
        self._is_shown.clear()
        self._process.send(Kind.ACTIONS, msgspec.msgpack.encode(decided))

    def end(self, why: str) -> None:
        """Ends the process, which writes the record; one that has not begun is not ended."""
        if self.begun:
            self._process.send(Kind.FAULT, json.dumps([Fault.TIMEOUT, why]).encode())

    def kill(self, why: str) -> None:
        """Kills the process."""
        self._process.kill(Outcome(End.STOPPED, why))

    def release(self) -> None:
        """Nothing will be shown any more: calls of `wait` return."""
        self._is_shown.set()
