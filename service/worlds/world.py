"""LiveWorld: a world in the server, and the lockstep of all who joined it.

All of it lives on the event loop and in memory. A tick begins once every seat has decided; a decision that is overdue
is repeated from the tick before, or costs the seat. The process shows each tick again after a change of drivers, with
the number of the change, so that no decision meets a tick that was shown before the change.
"""

from __future__ import annotations

import asyncio
import json
import secrets
import time
from collections.abc import Sequence

import msgspec

from dohyo.evaluation.agent import AgentSpec
from dohyo.service.errors import BusyError, ConflictError
from dohyo.service.running.channel import Fault, Kind
from dohyo.service.running.process import EpisodeProcess
from dohyo.service.wire.bodies import Reply, Step
from dohyo.service.wire.messages import NOTHING, Format, decode
from dohyo.service.wire.requests import StaleTickError
from dohyo.service.worlds.model import WorldStatus
from dohyo.service.worlds.order import Drivers, Late, WorldOrder
from dohyo.service.worlds.seat import Seat
from dohyo.service.worlds.shown import SHOWN, Shown
from dohyo.sumo_networks.errors import InvalidInputError

STEP_WAIT_S = 30.0
SHOW_S = 120.0


class LiveWorld:
    """A world with a process.

    Attributes:
        id: Identifier.
        owner: Owner.
        order: Scenario and what an ego without a driver does.
        status: Status.
        tick: Tick last shown.
        time_s: Simulated time of the tick, s.
        driving: Egos that still drive.
        seats: Seats by their identifiers.
        heard: Monotonic time of the last request.
        ending: Why it was ended; "" while it goes on.
    """

    def __init__(
        self, identifier: str, owner: str, order: WorldOrder, process: EpisodeProcess, deadline_s: float, late: Late
    ) -> None:
        self.id, self.owner, self.order = identifier, owner, order
        self.deadline_s, self.late = deadline_s, late
        self.status, self.tick, self.time_s = WorldStatus.WAITING, 0, 0.0
        self.driving: tuple[str, ...] = tuple(mission.name for mission in order.scenario.missions)
        self.seats: dict[str, Seat] = {}
        self.heard, self.ending = time.monotonic(), ""
        self._process = process
        self._observations: dict[str, msgspec.Raw] = {}
        self._revision, self._allowed = 0, 0
        self._is_shown = asyncio.Event()  # the tick with the present drivers is shown, and the process waits
        process.seen = self._seen

    # Control

    def resume(self) -> None:
        """Lets the world tick whenever all have decided; also before all egos have drivers."""
        self.status, self._allowed = WorldStatus.RUNNING, 0
        self._renew()
        self._advance()

    def pause(self) -> None:
        """Lets the world stand still after the present tick."""
        self.status, self._allowed = WorldStatus.PAUSED, 0

    def allow(self, ticks: int) -> None:
        """Lets a paused world go on for so many ticks.

        Raises:
            ConflictError: It is not paused.
        """
        if self.status is not WorldStatus.PAUSED:
            raise ConflictError(f"expected a paused world, this one is {self.status.value}")
        self._allowed += ticks
        self._renew()
        self._advance()

    def end(self, why: str) -> None:
        """Ends the world; its process writes the record."""
        self.ending = self.ending or why
        self._process.send(Kind.FAULT, json.dumps([Fault.TIMEOUT, why]).encode())

    @property
    def _goes_on(self) -> bool:
        return self.status is WorldStatus.RUNNING or self._allowed > 0

    def _renew(self) -> None:
        """Decisions are due from now on: while a world stands still, nobody is late."""
        for seat in self.seats.values():
            seat.due = time.monotonic() + self.deadline_s

    # Seats

    async def join(self, spec: AgentSpec, egos: Sequence[str], token_id: str) -> Seat:
        """Seats a worker. One that joins again by the same name takes its place back; the old identifier ends.

        Raises:
            InvalidInputError: There is no such ego.
            ConflictError: An ego has ended its drive, or another worker drives it.
            GoneError: The world, or the drives of its egos, ended meanwhile.
            BusyError: The simulation takes too long.
        """
        before = next((seat for seat in self.seats.values() if seat.spec.name == spec.name), None)
        self._check_free(egos, before)
        seat = Seat(f"s-{secrets.token_hex(12)}", secrets.token_urlsafe(32), spec, tuple(egos), token_id)
        seat.begin(self.tick, time.monotonic() + SHOW_S)
        if before is not None and (before.spec, before.egos) == (spec, seat.egos):
            seat.take_over(before)
            self._remove(before, "its worker joined again")
        else:
            free: dict[str, AgentSpec | None] = {}
            if before is not None:
                free = dict.fromkeys(before.egos)
                self._remove(before, "its worker joined again, otherwise")
            self._change(free | dict.fromkeys(egos, spec))
        self.seats[seat.id] = seat
        await self.shown()
        seat.refuse_ended()
        seat.begin(self.tick, time.monotonic() + self.deadline_s)
        if self.status is WorldStatus.WAITING and not self._undriven():
            self.resume()
        return seat

    def _check_free(self, egos: Sequence[str], before: Seat | None) -> None:
        names = [mission.name for mission in self.order.scenario.missions]
        held = {ego: seat for seat in self.seats.values() if seat is not before for ego in seat.egos}
        for ego in egos:
            if ego not in names:
                raise InvalidInputError(f"egos: expected some of {names[:50]}, got '{ego[:100]}'")
            if ego in held:
                raise ConflictError(f"ego '{ego}' has a driver: '{held[ego].spec.name}'")
            if ego not in self.driving and (before is None or ego not in before.egos):
                raise ConflictError(f"ego '{ego}' has ended its drive")

    def _undriven(self) -> list[str]:
        driven = {ego for seat in self.seats.values() for ego in seat.egos}
        return [ego for ego in self.driving if ego not in driven]

    def leave(self, seat: Seat, why: str) -> None:
        """Takes the place of a worker away; its egos have no driver from now on.

        Raises:
            GoneError: It has none any more.
        """
        seat.refuse_ended()
        self._remove(seat, why)
        self._change(dict.fromkeys(seat.egos))

    def _remove(self, seat: Seat, why: str) -> None:
        self.seats.pop(seat.id, None)
        seat.end(why)

    def _change(self, specs: dict[str, AgentSpec | None]) -> None:
        self._revision += 1
        self._is_shown.clear()
        drivers = Drivers(revision=self._revision, specs=specs)
        self._process.send(Kind.DRIVERS, drivers.model_dump_json().encode())

    async def shown(self) -> None:
        """Waits until the present tick is shown.

        Raises:
            BusyError: The simulation takes too long.
        """
        try:
            await asyncio.wait_for(self._is_shown.wait(), SHOW_S)
        except TimeoutError:
            raise BusyError(f"the simulation took longer than {SHOW_S:g} s for one tick", retry_s=5) from None

    def observations_of(self, seat: Seat) -> dict[str, msgspec.Raw]:
        """What a seat observes in the present tick."""
        return {ego: self._observations[ego] for ego in seat.egos if ego in self._observations}

    # The lockstep

    async def step(self, seat: Seat, step: Step, fmt: Format) -> Reply:
        """Takes a worker's decision and waits for the next tick.

        Raises:
            GoneError: The worker has no place any more.
            StaleTickError: The decision is for another tick.
            InvalidInputError: The decision is invalid; another one may follow before it is due.
            BusyError: The tick still waits for others; the same step may be sent again.
        """
        if step.tick == seat.answered and seat.reply is not None:
            return seat.reply
        seat.refuse_ended()
        if step.tick != seat.tick:
            raise StaleTickError(seat.tick, step.tick)
        if seat.decision is None:
            deciding = tuple(ego for ego in seat.egos if ego in self.driving)
            seat.decide(decode(bytes(step.actions), fmt), deciding)
        answer: asyncio.Future[Reply] = asyncio.get_running_loop().create_future()
        seat.waiting.append(answer)
        self._advance()
        try:
            return await asyncio.wait_for(answer, STEP_WAIT_S)
        except TimeoutError:
            raise BusyError("the tick waits for others, or the world is paused: send the same step again", 1) from None

    def _advance(self) -> None:
        """Begins the next tick if nothing holds it."""
        seats = self.seats.values()
        if not self._is_shown.is_set() or not self._goes_on or any(seat.decision is None for seat in seats):
            return
        if not seats and not self._allowed:
            return  # a world without drivers stands still, and ends after its idle time
        self._is_shown.clear()
        self._allowed = max(0, self._allowed - 1)
        decided = {ego: action for seat in seats for ego, action in (seat.decision or {}).items()}
        actions = {ego: action for ego, action in decided.items() if ego in self.driving}
        self._process.send(Kind.ACTIONS, msgspec.msgpack.encode(actions))

    def _seen(self, kind: Kind, payload: bytes) -> None:
        """Handles a tick that the process shows."""
        tick, time_s, revision = SHOWN.unpack_from(payload)
        if revision != self._revision:
            return  # it will be shown again, with the present drivers
        shown = msgspec.msgpack.decode(memoryview(payload)[SHOWN.size :], type=Shown)
        ticked = tick > self.tick
        self.tick, self.time_s, self.driving = tick, time_s, tuple(shown.driving)
        self._observations = shown.observations
        self._is_shown.set()
        for seat in list(self.seats.values()):
            self._show(seat, ticked)
        self._advance()

    def _show(self, seat: Seat, ticked: bool) -> None:
        done = not any(ego in self.driving for ego in seat.egos)
        if ticked:
            seat.due = time.monotonic() + self.deadline_s
            seat.show(self.tick, self.time_s, self.observations_of(seat), done=done)
        if done:
            self._remove(seat, "all of its egos have ended their drives")

    def sweep(self) -> None:
        """Repeats the decisions of those who are late, or takes their places away."""
        if not self._is_shown.is_set() or not self._goes_on:
            return
        now = time.monotonic()
        for seat in [one for one in self.seats.values() if one.decision is None and now > one.due]:
            if self.late == "repeat" and seat.last is not None:
                seat.decision, seat.missed = seat.last, seat.missed + 1
            else:
                self.leave(seat, f"no decision came in {self.deadline_s:g} s")
        self._advance()

    def over(self, why: str) -> None:
        """The process has ended: answers all who wait."""
        for seat in list(self.seats.values()):
            seat.reply = Reply(
                *(self.tick, self.time_s, NOTHING),
                done=True,
                missed=seat.missed,
                clipped=seat.clipped,
                directive="abort" if self.ending else "run",
            )
            seat.answered = seat.tick
            seat.answer(seat.reply)
            self._remove(seat, why)
        self._is_shown.set()
