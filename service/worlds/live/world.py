"""LiveWorld: a world in the server, and the lockstep of all who joined it.

All of it lives on the event loop and in memory. A tick begins once every seat has decided, and in real time once its
time has come; a decision that is overdue is repeated from the tick before, or costs the seat. The process shows each
tick again after a change of drivers, with the number of the change, so that no decision meets a tick that was shown
before the change.
"""

from __future__ import annotations

import asyncio
import json
import time

import msgspec
from msgspec import UNSET

from dohyo.evaluation.agent import AgentSpec
from dohyo.service.errors import BusyError, ConflictError
from dohyo.service.running.channel import Fault, Kind
from dohyo.service.running.process import End, EpisodeProcess, Outcome
from dohyo.service.simulating.actors import ActorChange, WorldActors
from dohyo.service.simulating.order import Drivers, Reset, WorldOrder, WorldRules
from dohyo.service.simulating.shown import SHOWN, Decided, Shown
from dohyo.service.spectating.broadcast import Broadcast
from dohyo.service.wire.messages import NOTHING, Format, decode
from dohyo.service.wire.requests import StaleTickError
from dohyo.service.worlds.bodies import FARTHEST_M, EgoOutcome, WorldReply, WorldStep
from dohyo.service.worlds.live.clock import Clock, ObeyedSteps, Pace
from dohyo.service.worlds.live.guests import Guests
from dohyo.service.worlds.live.seat import Seat
from dohyo.service.worlds.live.seats import Seats
from dohyo.service.worlds.model import WorldStatus
from dohyo.sumo_networks.ego.pose import Pose
from dohyo.sumo_networks.errors import InvalidInputError

MOST_SPECTATORS = 250
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
        clock: Pace of its ticks.
        seed: Seed of the present run.
        resets: How often it has begun anew.
        actors: Actors that other simulators have put into it.
        guests: Other owners who may join it.
        seats: Places of its workers.
        begun: Whether its first tick was shown.
        heard: Monotonic time of the last request, or when it ran in real time before spectators.
        ending: Why it was ended; "" while it goes on.
        audience: Its spectators.
    """

    def __init__(
        self, identifier: str, owner: str, order: WorldOrder, process: EpisodeProcess, rules: WorldRules
    ) -> None:
        self.id, self.owner, self.order = identifier, owner, order
        self.deadline_s, self.late = rules.deadline_s, rules.late
        self.clock, self.actors, self.guests = Clock(rules.pace, rules.speed), WorldActors(), Guests()
        self.seed, self.resets = order.scenario.seed, 0
        self.status, self.tick, self.time_s = WorldStatus.WAITING, 0, 0.0
        self.driving: tuple[str, ...] = tuple(mission.name for mission in order.scenario.missions)
        self.seats = Seats(self.driving)
        self.begun, self.heard, self.ending = False, time.monotonic(), ""
        self._process, self._obeyed = process, ObeyedSteps()
        self._broadcast = Broadcast(process.send, MOST_SPECTATORS)
        self.audience, self._plans = self._broadcast.audience, self._broadcast.plans
        self._shown = Shown([], {}, {})
        self._revision, self._allowed, self._restarted = 0, 0, False
        self._timer: asyncio.TimerHandle | None = None
        self._is_shown = asyncio.Event()  # the tick with the present drivers is shown, and the process waits
        process.seen = self._seen

    # Control

    def resume(self) -> None:
        """Lets the world tick whenever all have decided; also before all egos have drivers."""
        if self.status is not WorldStatus.OVER:
            self.status = WorldStatus.RUNNING
        self._allowed = 0
        self._renew()
        self._advance()

    def pause(self) -> None:
        """Lets the world stand still after the present tick."""
        if self.status is not WorldStatus.OVER:
            self.status = WorldStatus.PAUSED
        self._allowed = 0

    def change_pace(self, pace: Pace, speed: float) -> None:
        """Changes the pace, from the present tick on."""
        self.clock.change(pace, speed)
        self._renew()
        self._advance()

    def put_actors(self, change: ActorChange) -> None:
        """Puts, moves and removes actors of the owner, before the next tick.

        Raises:
            InvalidInputError: An actor cannot be.
            ConflictError: A worker has put an actor of this name.
        """
        self.actors.change("", change)

    async def reset(self, seed: int | None) -> None:
        """Begins anew at tick 0 with the same drivers and without external actors.

        Raises:
            BusyError: The world has not begun yet, or the simulation takes too long.
        """
        self._check_begun()
        self.seed = self.seed if seed is None else seed
        self.resets, self._revision, self._restarted = self.resets + 1, self._revision + 1, True
        self._allowed = 0
        self._is_shown.clear()
        self.actors.clear()
        self._plans.forget(self.seats.drivers)
        for seat in self.seats:
            seat.restart()
        if self.status is WorldStatus.OVER:
            self.status = WorldStatus.RUNNING
        self._process.send(Kind.RESET, Reset(revision=self._revision, seed=self.seed).model_dump_json().encode())
        await self.shown()

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
        self._renew()
        self._advance()

    def end(self, why: str) -> None:
        """Ends the world; its process writes the record."""
        self.ending = self.ending or why
        if self.begun:
            self._process.send(Kind.FAULT, json.dumps([Fault.TIMEOUT, why]).encode())

    def kill(self) -> None:
        """Kills the process of a world whose end takes too long."""
        self._process.kill(Outcome(End.STOPPED, f"{self.ending}; its process took too long to end"))

    def _check_begun(self) -> None:
        """Refuses what the process would take for its order."""
        if not self.begun:
            raise BusyError("the world has not begun yet", retry_s=1)

    @property
    def _goes_on(self) -> bool:
        return self.status is WorldStatus.RUNNING or self._allowed > 0

    def _renew(self) -> None:
        """Decisions are due from now on: while a world stands still, nobody is late."""
        self.clock.restart()
        self.seats.renew(time.monotonic() + self.deadline_s)

    # Seats

    async def join(self, seat: Seat) -> None:
        """Seats a worker. One that joins again by the same name takes its place back; the old identifier ends.

        Raises:
            InvalidInputError: There is no such ego.
            ConflictError: An ego has ended its drive, or another worker drives it or has the name.
            GoneError: The world, or the drives of its egos, ended meanwhile.
            TooManyRequestsError: The owner has too many places without an ego.
            BusyError: The world has not begun yet, or the simulation takes too long.
        """
        self._check_begun()
        before = self.seats.named(seat.spec.name)
        self.seats.check_free(seat, before, self.driving)
        seat.begin(self.tick, time.monotonic() + SHOW_S)
        if before is not None and before.is_like(seat):
            seat.take_over(before)
            self.seats.remove(before, "its worker joined again")
        else:
            free: dict[str, AgentSpec | None] = {}
            if before is not None:
                free = dict.fromkeys(before.egos)
                self.seats.remove(before, "its worker joined again, otherwise")
                self.actors.forget(seat.spec.name)
            self.seats.add(seat)
            self._change(free | dict.fromkeys(seat.egos, seat.spec))
        self.seats.add(seat)
        await self.shown()
        seat.refuse_ended()
        seat.begin(self.tick, time.monotonic() + self.deadline_s)
        if self.status is WorldStatus.WAITING and self.seats.drivers.keys() >= set(self.driving):
            self.resume()

    def leave(self, seat: Seat, why: str) -> None:
        """Takes the place of a worker away; its egos have no driver from now on.

        Raises:
            GoneError: It has none any more.
        """
        seat.refuse_ended()
        self.seats.remove(seat, why)
        self.actors.forget(seat.spec.name)
        self._plans.forget(seat.egos)
        self._change(dict.fromkeys(seat.egos))

    def _change(self, specs: dict[str, AgentSpec | None]) -> None:
        self._revision += 1
        self._is_shown.clear()
        drivers = Drivers(revision=self._revision, specs=specs, coupled=self.seats.coupled)
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

    def reply_to(self, seat: Seat) -> WorldReply:
        """What a seat observes in the present tick."""
        seen = {ego: self._shown.observations[ego] for ego in seat.egos if ego in self._shown.observations}
        return WorldReply(
            *(self.tick, self.time_s, msgspec.Raw(msgspec.msgpack.encode(seen))),
            done=not any(ego in self.driving for ego in seat.egos or self.driving),
            missed=seat.missed,
            clipped=seat.clipped,
            directive="run",
            resets=self.resets,
            actors=(self._shown.actors or []) if seat.coupled else UNSET,
            outcomes=self._outcomes_of(seat) if self.order.reward else UNSET,
        )

    def _outcomes_of(self, seat: Seat) -> dict[str, EgoOutcome]:
        shown = self._shown.outcomes
        return {ego: EgoOutcome(*shown[ego]) for ego in seat.egos if ego in shown}

    # The lockstep

    async def step(self, seat: Seat, step: WorldStep, fmt: Format) -> WorldReply:
        """Takes a worker's decision and waits for the next tick.

        Raises:
            GoneError: The worker has no place any more.
            StaleTickError: The decision is for another tick; in real time, one that comes late is for the present one.
            InvalidInputError: The decision is invalid; another one may follow before it is due.
            ConflictError: Another worker has put an actor.
            BusyError: The tick still waits for others; the same step may be sent again.
        """
        comes_late = self.clock.realtime and seat.repeated and step.tick < seat.tick
        if step.tick == seat.answered and seat.reply is not None and not comes_late:
            if seat.repeated and not seat.ended:
                self._change_actors(seat, step)  # it came too late for its tick: its actors are for the next one
            return seat.reply
        seat.refuse_ended()
        if self._restarted:  # it is of the run before, and answered as those that waited at the reset
            return await self._next(seat)
        if step.tick != seat.tick and not comes_late:
            raise StaleTickError(seat.tick, step.tick)
        # In real time a repetition may be under way; then this decision is the one that the next tick has.
        if seat.decision is None or (self.clock.realtime and seat.repeated):
            self._decide(seat, step, fmt)
        elif seat.repeated:
            self._change_actors(seat, step)
        if self.clock.realtime:  # also where the repetition of its last decision is being driven
            seat.due = time.monotonic() + self.deadline_s
        return await self._next(seat)

    async def _next(self, seat: Seat) -> WorldReply:
        answer: asyncio.Future[WorldReply] = asyncio.get_running_loop().create_future()
        seat.waiting.append(answer)
        self._advance()
        try:
            return await asyncio.wait_for(answer, STEP_WAIT_S)
        except TimeoutError:
            raise BusyError("the tick waits for others, or the world is paused: send the same step again", 1) from None
        finally:
            if answer in seat.waiting:  # nobody waits for it any more
                seat.waiting.remove(answer)

    def _decide(self, seat: Seat, step: WorldStep, fmt: Format) -> None:
        """Takes all that a step has, or nothing of it."""
        deciding = tuple(ego for ego in seat.egos if ego in self.driving)
        poses = {ego: Pose(*pose) for ego, pose in self._shown.poses.items()}
        decision = seat.check(decode(bytes(step.actions), fmt), deciding, poses)
        plans = step.plans or {}
        self._plans.check(plans, seat.egos, FARTHEST_M)
        self._change_actors(seat, step)  # the last one that may refuse
        self._plans.take(plans, seat.tick)
        seat.decide(decision)

    def _change_actors(self, seat: Seat, step: WorldStep) -> None:
        if step.actors is None:
            return
        if not seat.coupled:
            raise InvalidInputError("actors: expected none of a place that did not join with coupled: true")
        self.actors.change(seat.spec.name, step.actors)

    def _advance(self) -> None:
        """Begins the next tick if nothing holds it."""
        if not self._is_shown.is_set() or not self._goes_on or not self.driving or not self._may_begin():
            return
        self._is_shown.clear()
        self._allowed = max(0, self._allowed - 1)
        self.clock.begin(time.monotonic())
        decided = Decided(self.seats.decisions(self.driving), self.actors.changed())
        self._process.send(Kind.ACTIONS, msgspec.msgpack.encode(decided))

    def _may_begin(self) -> bool:
        """Whether the decisions are there, or in real time the tick's time has come."""
        silent = self.seats.silent
        if not self.clock.realtime:
            # A world without drivers stands still, and ends after its idle time.
            return not silent and bool(self.seats or self._allowed)
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
        self._timer = asyncio.get_running_loop().call_later(wait_s, self._advance)

    def _seen(self, kind: Kind, payload: bytes) -> None:
        """Handles a tick that the process shows, to the drivers or to spectators."""
        if kind in (Kind.STAGE, Kind.SCENE):
            self._broadcast.show(kind, payload)
            return
        tick, time_s, revision = SHOWN.unpack_from(payload)
        if revision != self._revision:
            return  # it will be shown again, with the present drivers
        self._shown = msgspec.msgpack.decode(memoryview(payload)[SHOWN.size :], type=Shown)
        if not self.begun:
            self.begun, self.heard = True, time.monotonic()
            self._broadcast.begin()
            if self.ending:  # before it had begun
                self.end(self.ending)
        restarted, self._restarted = self._restarted, False
        ticked = tick > self.tick or restarted
        self.tick, self.time_s, self.driving = tick, time_s, tuple(self._shown.driving)
        if not self.driving:
            self.status = WorldStatus.OVER
        self._is_shown.set()
        for seat in self.seats:
            self._show(seat, ticked)
        if restarted:
            self._renew()
        self._advance()

    def _show(self, seat: Seat, ticked: bool) -> None:
        reply = self.reply_to(seat)
        if ticked:
            if not self.clock.realtime:
                seat.due = time.monotonic() + self.deadline_s
            seat.show(reply)
        if reply.done and not self.order.stays:
            self.seats.remove(seat, "all of its egos have ended their drives")

    def sweep(self) -> None:
        """Tells spectators what has changed; repeats late decisions, or takes the places of late workers away."""
        self._tell_state()
        now = time.monotonic()
        self.audience.beat(now)
        if not self._goes_on or not self.driving:
            return
        if self.clock.realtime and self.audience.watching:
            self.heard = now
        if not self._is_shown.is_set():
            # A world that is slower than its pace is always at a tick.
            for seat in [one for one in self.seats if self.clock.realtime and one.repeated and now > one.due]:
                self.leave(seat, f"no decision came in {self.deadline_s:g} s")
            return
        for seat in [one for one in self.seats.silent if now > one.due]:
            if self.late == "repeat" and seat.last is not None and not self.clock.realtime:
                seat.repeat()
            else:
                self.leave(seat, f"no decision came in {self.deadline_s:g} s")
        self._advance()

    def _tell_state(self) -> None:
        drivers = self.seats.drivers
        egos = [
            {"name": mission.name, "driver": drivers.get(mission.name), "driving": mission.name in self.driving}
            for mission in self.order.scenario.missions
        ]
        self._broadcast.tell_state({"status": self.status.value, "egos": egos})

    def over(self, why: str) -> None:
        """The process has ended: answers all who wait."""
        for seat in self.seats:
            seat.reply = WorldReply(
                *(self.tick, self.time_s, NOTHING),
                done=True,
                missed=seat.missed,
                clipped=seat.clipped,
                directive="abort" if self.ending else "run",
                resets=self.resets,
            )
            seat.answered = seat.tick
            seat.answer(seat.reply)
            self.seats.remove(seat, why)
        self.audience.end(msgspec.json.encode({"status": self.status.value, "reason": why}))
        self._is_shown.set()
