"""Steps: what the workers of a world decide, put and intend for a tick, and what they are answered."""

from __future__ import annotations

import asyncio

import msgspec
from msgspec import UNSET

from dohyo.service.errors import BusyError, TooLargeError
from dohyo.service.simulating.actors import WorldActors
from dohyo.service.spectating.plans import Plans
from dohyo.service.wire.messages import NOTHING, Format, decode
from dohyo.service.wire.requests import BODY_LIMIT, StaleTickError
from dohyo.service.worlds.bodies import FARTHEST_M, EgoOutcome, WorldReply, WorldStep
from dohyo.service.worlds.live.lockstep import Lockstep
from dohyo.service.worlds.live.seat import Seat
from dohyo.service.worlds.live.simulation import Simulation
from dohyo.sumo_networks.ego.pose import Pose
from dohyo.sumo_networks.errors import InvalidInputError

STEP_WAIT_S = 30.0


class Steps:
    """Takes the steps of a world's seats."""

    def __init__(
        self, simulation: Simulation, lockstep: Lockstep, actors: WorldActors, plans: Plans, *, rewarded: bool
    ) -> None:
        """Begins in a world.

        Args:
            simulation: Its process.
            lockstep: Which begins its ticks.
            actors: Actors that other simulators put.
            plans: Last plans of the drivers.
            rewarded: Whether replies have outcomes.
        """
        self._simulation, self._lockstep, self._rewarded = simulation, lockstep, rewarded
        self._actors, self._plans = actors, plans

    async def take(self, seat: Seat, step: WorldStep, fmt: Format) -> WorldReply:
        """Takes a worker's decision and waits for the next tick.

        Raises:
            GoneError: The worker has no place any more.
            StaleRunError: The decision is for a run before the last reset.
            StaleTickError: The decision is for another tick; in real time, one that comes late is for the present one.
            InvalidInputError: The decision is invalid; another one may follow before it is due.
            ConflictError: Another worker has put an actor.
            BusyError: The tick still waits for others; the same step may be sent again.
        """
        seat.refuse_stale_run(step.resets)
        realtime = self._lockstep.clock.realtime
        comes_late = realtime and seat.repeated and step.tick < seat.tick
        if step.tick == seat.answered and seat.reply is not None and not comes_late:
            if seat.repeated and not seat.ended:
                self._change_actors(seat, step)  # it came too late for its tick: its actors are for the next one
            return seat.reply
        seat.refuse_ended()
        if self._simulation.restarting:  # it is of the run before, and answered as those that waited at the reset
            return await self._next(seat)
        if step.tick != seat.tick and not comes_late:
            raise StaleTickError(seat.tick, step.tick)
        # In real time a repetition may be under way; then this decision is the one that the next tick has.
        if seat.decision is None or (realtime and seat.repeated):
            self._decide(seat, step, fmt)
        elif seat.repeated:
            self._change_actors(seat, step)
        if realtime:  # also where the repetition of its last decision is being driven
            seat.due = self._lockstep.due()
        return await self._next(seat)

    async def _next(self, seat: Seat) -> WorldReply:
        answer: asyncio.Future[WorldReply] = asyncio.get_running_loop().create_future()
        seat.waiting.append(answer)
        self._lockstep.advance()
        try:
            return await asyncio.wait_for(answer, STEP_WAIT_S)
        except TimeoutError:
            raise BusyError("the tick waits for others, or the world is paused: send the same step again", 1) from None
        finally:
            if answer in seat.waiting:  # nobody waits for it any more
                seat.waiting.remove(answer)

    def _decide(self, seat: Seat, step: WorldStep, fmt: Format) -> None:
        """Takes all that a step has, or nothing of it."""
        if memoryview(step.actions).nbytes > BODY_LIMIT:  # nested lists take the event loop a second for each 2 MB
            raise TooLargeError(BODY_LIMIT)
        deciding = tuple(ego for ego in seat.egos if ego in self._simulation.driving)
        poses = {ego: Pose(*pose) for ego, pose in self._simulation.shown.poses.items()}
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
        self._actors.change(seat.spec.name, step.actors)

    def reply_to(self, seat: Seat) -> WorldReply:
        """What a seat observes in the present tick."""
        now = self._simulation
        seen = {ego: now.shown.observations[ego] for ego in seat.egos if ego in now.shown.observations}
        return WorldReply(
            *(now.tick, now.time_s, msgspec.Raw(msgspec.msgpack.encode(seen))),
            done=not any(ego in now.driving for ego in seat.egos or now.driving),
            missed=seat.missed,
            clipped=seat.clipped,
            directive="run",
            resets=now.shown_resets,
            actors=(now.shown.actors or []) if seat.coupled else UNSET,
            outcomes=self._outcomes_of(seat) if self._rewarded else UNSET,
        )

    def _outcomes_of(self, seat: Seat) -> dict[str, EgoOutcome]:
        shown = self._simulation.shown.outcomes
        return {ego: EgoOutcome(*shown[ego]) for ego in seat.egos if ego in shown}

    def answer_last(self, seat: Seat, *, aborted: bool) -> None:
        """Answers a seat of a world that has ended, without observations."""
        seat.reply = WorldReply(
            *(self._simulation.tick, self._simulation.time_s, NOTHING),
            done=True,
            missed=seat.missed,
            clipped=seat.clipped,
            directive="abort" if aborted else "run",
            resets=seat.resets,
        )
        seat.answered = seat.tick
        seat.answer(seat.reply)
