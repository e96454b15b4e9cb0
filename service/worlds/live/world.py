"""LiveWorld: a world in the server, with all who joined it. All of it lives on the event loop and in memory."""

from __future__ import annotations

import time

import msgspec

from dohyo.evaluation.agent import AgentSpec
from dohyo.service.running.channel import Kind
from dohyo.service.running.process import EpisodeProcess
from dohyo.service.simulating.actors import ActorChange, WorldActors
from dohyo.service.simulating.order import WorldOrder, WorldRules
from dohyo.service.spectating.broadcast import Broadcast
from dohyo.service.workers.loop_clock import LoopClock
from dohyo.service.worlds.live.guests import Guests
from dohyo.service.worlds.live.lockstep import Lockstep
from dohyo.service.worlds.live.seat import Seat
from dohyo.service.worlds.live.seats import Seats
from dohyo.service.worlds.live.simulation import SHOW_S, Simulation
from dohyo.service.worlds.live.steps import Steps
from dohyo.service.worlds.model import WorldStatus

MOST_SPECTATORS = 250


class LiveWorld:
    """A world with a process.

    Attributes:
        id: Identifier.
        owner: Owner.
        order: Scenario and what an ego without a driver does.
        actors: Actors that other simulators have put into it.
        guests: Invitations to other owners, who may join it.
        seats: Places of its workers.
        simulation: Its process, and the tick that it has shown last.
        lockstep: Its status and pace: when its ticks begin.
        steps: What its workers decide, and are answered.
        heard: Time of the loop at the last request, or when it ran in real time before spectators, or to its end.
        ending: Why it was ended; "" while it goes on.
        audience: Its spectators.
    """

    def __init__(
        self,
        identifier: str,
        owner: str,
        order: WorldOrder,
        process: EpisodeProcess,
        rules: WorldRules,
        loop: LoopClock,
    ) -> None:
        self.id, self.owner, self.order = identifier, owner, order
        self._loop = loop
        self.heard, self.ending = loop.monotonic(), ""
        egos = [mission.name for mission in order.scenario.missions]
        self.actors, self.guests, self.seats = WorldActors(), Guests(), Seats(egos)
        self.simulation = Simulation(process, egos, order.scenario.seed)
        self.lockstep = Lockstep(self.simulation, self.seats, self.actors, rules, loop)
        self._broadcast = Broadcast(process.send, MOST_SPECTATORS)
        self.audience, self._plans = self._broadcast.audience, self._broadcast.plans
        rewarded = order.reward is not None
        self.steps = Steps(self.simulation, self.lockstep, self.actors, self._plans, rewarded=rewarded)
        process.seen = self._seen

    # Control

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
        self.simulation.check_begun()
        self.actors.clear()
        self._plans.forget(self.seats.drivers)
        self.seats.restart()
        self.lockstep.restart()
        self.simulation.restart(seed)
        await self.simulation.wait()

    def end(self, why: str) -> None:
        """Ends the world; its process writes the record."""
        self.ending = self.ending or why
        self.simulation.end(why)

    def kill(self) -> None:
        """Kills the process of a world whose end takes too long."""
        self.simulation.kill(f"{self.ending}; its process took too long to end")

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
        self.simulation.check_begun()
        before = self.seats.named(seat.spec.name)
        self.seats.check_free(seat, before, self.simulation.driving)
        seat.begin(self.simulation.tick, self.simulation.shown_resets, self._loop.monotonic() + SHOW_S)
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
        await self.simulation.wait()
        seat.refuse_ended()
        seat.begin(self.simulation.tick, self.simulation.shown_resets, self.lockstep.due())
        all_driven = self.seats.drivers.keys() >= set(self.simulation.driving)
        if self.lockstep.status is WorldStatus.WAITING and all_driven:
            self.lockstep.resume()

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

    def dismiss_guest(self, owner: str) -> None:
        """Takes the places of a guest away, and ends its invitations and what it watches."""
        self.guests.dismiss(owner)
        for seat in [one for one in self.seats if one.owner == owner]:
            self.leave(seat, "the owner of the world has dismissed its guest")
        self.audience.dismiss(lambda spectator: spectator.owner == owner)

    def _change(self, specs: dict[str, AgentSpec | None]) -> None:
        self.simulation.change_drivers(specs, coupled=self.seats.coupled)

    # Ticks

    def _seen(self, kind: Kind, payload: bytes) -> None:
        """Handles a tick that the process shows, to the drivers or to spectators."""
        if kind in (Kind.STAGE, Kind.SCENE):
            self._broadcast.show(kind, payload)
            return
        news = self.simulation.take(payload)
        if news is None:
            return
        if news.first:
            self.heard = self._loop.monotonic()
            self._broadcast.begin()
            if self.ending:  # before it had begun
                self.end(self.ending)
        if not self.simulation.driving:
            self.lockstep.status = WorldStatus.OVER
        for seat in self.seats:
            self._show(seat, news.ticked)
        if news.restarted:
            self.lockstep.renew()
        self.lockstep.advance()

    def _show(self, seat: Seat, ticked: bool) -> None:
        reply = self.steps.reply_to(seat)
        if ticked:
            if not self.lockstep.clock.realtime:
                seat.due = self.lockstep.due()
            seat.show(reply)
        if reply.done and not self.order.stays:
            self.seats.remove(seat, "all of its egos have ended their drives", driven=True)
            self.actors.forget(seat.spec.name)

    def sweep(self) -> None:
        """Tells spectators what has changed; repeats late decisions, or takes the places of late workers away."""
        self._tell_state()
        self.audience.beat(time.monotonic())
        if not self.lockstep.goes_on:
            return
        now = self._loop.monotonic()
        if self.lockstep.ends_alone or (self.lockstep.clock.realtime and self.audience.watching):
            self.heard = now
        for seat in self.lockstep.repeat_late(now):
            self.leave(seat, f"no decision came in {self.lockstep.deadline_s:g} s")
        self.lockstep.advance()

    def _tell_state(self) -> None:
        drivers, driving = self.seats.drivers, self.simulation.driving
        egos = [
            {"name": mission.name, "driver": drivers.get(mission.name), "driving": mission.name in driving}
            for mission in self.order.scenario.missions
        ]
        self._broadcast.tell_state({"status": self.lockstep.status.value, "egos": egos})

    def over(self, why: str) -> None:
        """The process has ended: answers all who wait."""
        for seat in self.seats:
            self.steps.answer_last(seat, aborted=bool(self.ending))
            self.seats.remove(seat, why)
        self.audience.end(msgspec.json.encode({"status": self.lockstep.status.value, "reason": why}))
        self.simulation.release()
