"""LeaseBook: workers, the episodes that they hold, and the lockstep between them.

All of it lives on the event loop and in memory. A lease is fenced by its identifier: a worker that lost its lease
cannot reach the episode, which gets a new lease. A worker that sends any request after its decision was due has an
agent that is too slow: a fault of the agent. A worker that sends none until its lease ends has vanished: that costs the
submission an attempt, and so does an episode that is given back after its first step.
"""

from __future__ import annotations

import asyncio
import json
import secrets
from collections import OrderedDict, deque
from collections.abc import Callable
from typing import Any

import msgspec

from dohyo.evaluation.episode.guarded_agent import RESET_DEADLINE_S
from dohyo.service.errors import ConflictError, GoneError, TooManyRequestsError, UnauthorisedError
from dohyo.service.running.channel import FORMATS, SEEN, Fault, Kind
from dohyo.service.running.process import End, Outcome
from dohyo.service.wire.answering import answer_all
from dohyo.service.wire.bodies import Directive, Reply, Step
from dohyo.service.wire.messages import NOTHING, Format
from dohyo.service.wire.requests import StaleTickError
from dohyo.service.workers.lease import Lease, RemoteEpisode, Worker
from dohyo.service.workers.loop_clock import LoopClock
from dohyo.sumo_networks.errors import InvalidInputError

SWEEP_S = 0.1
WORKERS_PER_OWNER = 256
POLL_PAUSE_S = 5.0  # a worker counts as waiting for so long after its last poll
FORGET_S = 300.0  # silent workers and replies of ended leases are forgotten after it
MOST_RETURNS = 3
MOST_RETURNED = 100_000  # episodes whose returns are counted; those that returned last, since some never finish
LONGEST_TICK_S = 120.0  # time for the simulation's tick
SLOWEST_PACE = 10.0  # the same per simulated second where a decision holds for longer: a planner can fill the road
UNTOLD = {
    End.FAILED: "the simulation failed; the evaluation has the reason",
    End.IMPOSSIBLE: "the episode cannot be driven; the evaluation has the reason",
}
"""Reasons that workers get for ends whose own text may name the scenario."""


class LeaseBook:
    """All workers, leases, and episodes that wait for a worker.

    Attributes:
        draining: Whether no more episodes are leased.
        fresh: Callback for a worker that begins to wait.
    """

    def __init__(self, lease_ttl_s: float, clock: LoopClock | None = None) -> None:
        self.lease_ttl_s, self._clock = lease_ttl_s, clock or LoopClock()
        self.draining = False
        self.fresh: Callable[[], None] = lambda: None
        self._workers: dict[str, Worker] = {}
        self._tokens: dict[str, Worker] = {}
        self._leases: dict[str, Lease] = {}
        self._offers: list[RemoteEpisode] = []
        # Returns without a step, by episode, over all its attempts, also after a cancellation; the latest comes last.
        self._returns: OrderedDict[str, int] = OrderedDict()
        self._polls: deque[tuple[Worker, asyncio.Future[Any]]] = deque()

    # Workers

    def register(self, agent: str, owner: str, token_id: str, capacity: int, version: int | None) -> Worker:
        """Registers a worker.

        Raises:
            TooManyRequestsError: The owner has too many workers.
        """
        self._forget()
        if sum(worker.owner == owner for worker in self._workers.values()) >= WORKERS_PER_OWNER:
            raise TooManyRequestsError(f"expected at most {WORKERS_PER_OWNER} workers of one owner", retry_s=60)
        worker = Worker(
            id=f"w-{secrets.token_hex(8)}",
            token=secrets.token_urlsafe(32),
            agent=agent,
            owner=owner,
            token_id=token_id,
            version=version,
            capacity=capacity,
            seen=self._clock.monotonic(),
        )
        self._workers[worker.id] = self._tokens[worker.token] = worker
        return worker

    def worker_of(self, token: str) -> Worker:
        """The worker of a token.

        Raises:
            UnauthorisedError: The token is unknown or no longer valid.
        """
        worker = self._tokens.get(token)
        if worker is None:
            raise UnauthorisedError("expected the token of a registered worker; register again (POST /v1/workers)")
        worker.seen = self._clock.monotonic()
        return worker

    def token_ids(self) -> set[str]:
        """API tokens that workers were registered with."""
        return {worker.token_id for worker in self._workers.values()}

    def dismiss(self, token_id: str) -> None:
        """Removes the workers of an API token that is no longer valid, and ends their leases and their waiting."""
        for worker in [one for one in self._workers.values() if one.token_id == token_id]:
            del self._workers[worker.id], self._tokens[worker.token]
            for given in [given for waiting, given in self._polls if waiting is worker]:
                given.cancel()
            for lease in [self._leases[one] for one in worker.leases]:
                self._lose(lease, End.WORKER_GONE, "the token of the worker is no longer valid")

    def _refuse_dismissed(self, worker: Worker) -> None:
        if worker.id not in self._workers:
            raise UnauthorisedError("the token that this worker was registered with is no longer valid")

    def demand(self, agent: str, version: int) -> int:
        """Number of episodes of a submission that workers wait for."""
        now = self._clock.monotonic()
        return sum(
            max(0, worker.capacity - len(worker.leases))
            for worker in self._workers.values()
            if worker.agent == agent and worker.version in (None, version)
            if worker.polls or now - worker.seen < POLL_PAUSE_S
        )

    def counts(self) -> dict[str, int]:
        """Numbers of workers and leases."""
        now = self._clock.monotonic()
        alive = sum(bool(worker.polls or worker.leases) or now - worker.seen < 30 for worker in self._workers.values())
        return {"workers": alive, "leases": sum(not lease.ended for lease in self._leases.values())}

    # Leasing

    async def acquire(self, worker: Worker, wait_s: float, left: asyncio.Future[Any]) -> Lease | None:
        """Waits for an episode and leases it to a worker.

        Args:
            worker: The waiting worker.
            wait_s: Longest wait.
            left: Completes once the worker closes its connection; it gets no episode then.

        Raises:
            ConflictError: The worker holds as many episodes as its capacity.
            UnauthorisedError: The worker was dismissed, be it while it waited.
        """
        self._refuse_dismissed(worker)
        if len(worker.leases) + worker.polls >= worker.capacity:
            raise ConflictError(f"expected at most {worker.capacity} episodes at once, as the worker was registered")
        for episode in self._offers:
            if worker.takes(episode) and not self.draining:
                return self._give(episode, worker)
        given: asyncio.Future[Any] = asyncio.get_running_loop().create_future()
        entry = (worker, given)
        self._polls.append(entry)
        worker.polls += 1
        self.fresh()
        try:
            if not self.draining:
                await asyncio.wait([given, left], timeout=wait_s, return_when=asyncio.FIRST_COMPLETED)
        finally:
            worker.polls -= 1
            worker.seen = self._clock.monotonic()
            if entry in self._polls:
                self._polls.remove(entry)
        self._refuse_dismissed(worker)
        if not given.done() or given.cancelled():
            return None
        lease: Lease = given.result()
        if left.done():
            self._give_back(lease, "the worker had left")
            return None
        return lease

    def expect(self, episode: RemoteEpisode) -> RemoteEpisode:
        """Offers an episode once its process has sent observations."""

        def ready(kind: Kind, payload: bytes) -> None:
            episode.frame = payload
            self._offer(episode)

        episode.process.seen = ready
        return episode

    def _offer(self, episode: RemoteEpisode) -> None:
        """Leases an episode to the worker that has waited longest, or keeps it for the next one."""
        episode.offered = self._clock.monotonic()
        for worker, given in self._polls:
            if worker.takes(episode) and not given.done() and not self.draining:
                given.set_result(self._give(episode, worker))
                return
        self._offers.append(episode)

    def _give(self, episode: RemoteEpisode, worker: Worker) -> Lease:
        if episode in self._offers:
            self._offers.remove(episode)
        now = self._clock.monotonic()
        lease = Lease(f"l-{secrets.token_hex(12)}", worker, episode, heard=now, due=now + RESET_DEADLINE_S)
        self._leases[lease.id] = lease
        worker.leases.add(lease.id)
        episode.held = True
        episode.process.seen = lambda kind, payload: self._seen(lease, kind, payload)
        episode.process.send(Kind.GRANT)
        return lease

    def _give_back(self, lease: Lease, why: str) -> None:
        """Offers an episode again that its worker has returned without a step."""
        self._end(lease, why)
        lease.episode.held = False
        self._count_return(lease.episode)
        self._offer(lease.episode)

    def _count_return(self, episode: RemoteEpisode) -> None:
        self._returns[episode.order.stem] = self._returns.pop(episode.order.stem, 0) + 1
        if len(self._returns) > MOST_RETURNED:
            self._returns.popitem(last=False)

    # The lockstep

    def lease_of(self, worker: Worker, lease_id: str) -> Lease:
        """A lease of a worker, active or ended.

        Raises:
            GoneError: The lease is unknown or ended long ago.
        """
        lease = self._leases.get(lease_id)
        if lease is None or lease.worker is not worker:
            raise GoneError(f"no lease '{lease_id[:40]}' of this worker: acquire another episode")
        return lease

    async def step(self, lease: Lease, step: Step, fmt: Format) -> Reply:
        """Passes a worker's decision to the simulation and waits for the reply.

        Raises:
            GoneError: The lease has ended.
            StaleTickError: The decision is for another tick.
            InvalidInputError: The decision is invalid; the worker may send another one before the deadline.
        """
        if step.tick == lease.answered and lease.reply is not None:
            self._heard(lease)
            return lease.reply
        self._refuse_ended(lease)
        if step.tick != lease.tick:
            raise StaleTickError(lease.tick, step.tick)
        if lease.moving is None:
            self._heard(lease)
            self._refuse_ended(lease)
            lease.moving, lease.refused, lease.episode.stepped = lease.heard, False, True
            lease.episode.process.send(Kind.ACTIONS, bytes([FORMATS.index(fmt)]) + bytes(step.actions))
        answer: asyncio.Future[Reply] = asyncio.get_running_loop().create_future()
        lease.waiting.append(answer)
        return await answer

    def heartbeat(self, lease: Lease) -> None:
        """Renews a lease.

        Raises:
            GoneError: The lease has ended.
        """
        self._refuse_ended(lease)
        self._heard(lease)
        self._refuse_ended(lease)

    def release(self, lease: Lease, fault: Fault | None, text: str) -> None:
        """Ends a lease at the worker's request.

        Args:
            lease: Active lease.
            fault: Fault of the agent; None: the worker cannot continue.
            text: Reason.

        Raises:
            GoneError: The lease has ended.
        """
        self._refuse_ended(lease)
        self._heard(lease)
        self._refuse_ended(lease)
        if fault is not None:
            self._fail(lease, fault, text)
        elif self.is_costly(lease.episode):
            self._lose(lease, End.GIVEN_BACK, f"the worker gave the episode back: {text}")
        else:
            self._give_back(lease, "given back")

    def _heard(self, lease: Lease) -> None:
        """Renews a lease; a request after the deadline shows that the agent is too slow."""
        lease.heard = self._clock.monotonic()
        if not lease.ended and lease.moving is None and lease.heard > lease.due:
            self._time_out(lease)

    def _refuse_ended(self, lease: Lease) -> None:
        if lease.ended:
            raise GoneError(f"lease lost: {lease.ended}")

    def _seen(self, lease: Lease, kind: Kind, payload: bytes) -> None:
        """Handles a frame of the episode's process."""
        if lease.ended:
            return
        if kind is Kind.REFUSED:
            lease.moving, lease.refused = None, True
            answer_all(lease.waiting, InvalidInputError(payload.decode()))
            return
        lease.episode.frame = payload
        if lease.waiting:
            self._show(lease)

    def _show(self, lease: Lease) -> None:
        """Answers the worker with the current observations."""
        tick, time_s, missed, clipped = SEEN.unpack_from(lease.episode.frame)
        seen = msgspec.Raw(memoryview(lease.episode.frame)[SEEN.size :])
        directive: Directive = "drain" if self.draining else "run"
        reply = Reply(tick, time_s, seen, done=False, missed=missed, clipped=clipped, directive=directive)
        lease.answered, lease.reply, lease.tick = lease.tick, reply, tick
        lease.moving, lease.heard = None, self._clock.monotonic()
        lease.due = lease.heard + lease.episode.order.act_deadline_s
        answer_all(lease.waiting, reply)

    # Ends

    def is_costly(self, episode: RemoteEpisode) -> bool:
        """Whether it counts against the submission if its worker or its owner ends the attempt now.

        It does once a worker has made a step, or has seen the first observations too often.
        """
        return episode.stepped or (episode.held and self._returns.get(episode.order.stem, 0) >= MOST_RETURNS)

    def ended(self, episode: RemoteEpisode, outcome: Outcome, directive: Directive = "run") -> None:
        """Ends the lease on an episode that has ended, if there is one."""
        if episode in self._offers:
            self._offers.remove(episode)
        for lease in self._leases.values():
            if lease.episode is episode and not lease.ended:
                self._finish(lease, outcome, directive)
                if directive == "abort" and not episode.stepped:
                    self._count_return(episode)
        if outcome.end is End.FINISHED:
            self._returns.pop(episode.order.stem, None)

    def _finish(self, lease: Lease, outcome: Outcome, directive: Directive) -> None:
        if outcome.end is End.FINISHED or directive == "abort":
            tick, time_s, missed, clipped = SEEN.unpack_from(outcome.last or lease.episode.frame)
            lease.reply = Reply(tick, time_s, NOTHING, done=True, missed=missed, clipped=clipped, directive=directive)
            lease.answered = lease.tick
            answer_all(lease.waiting, lease.reply)
        self._end(lease, UNTOLD.get(outcome.end) or outcome.text or "the episode has ended")

    def _end(self, lease: Lease, why: str) -> None:
        lease.ended = lease.ended or why
        lease.worker.leases.discard(lease.id)
        answer_all(lease.waiting, GoneError(f"lease lost: {lease.ended}"))
        self.fresh()

    def _time_out(self, lease: Lease) -> None:
        order = lease.episode.order
        seconds = order.act_deadline_s if lease.answered >= 0 else RESET_DEADLINE_S
        self._fail(lease, Fault.TIMEOUT, f"agent '{order.agent}' took longer than {seconds:g} s")

    def _fail(self, lease: Lease, fault: Fault, text: str) -> None:
        """Ends an episode with an agent fault; its process writes the record."""
        lease.episode.process.send(Kind.FAULT, json.dumps([fault.value, text]).encode())
        self._end(lease, text)

    def _lose(self, lease: Lease, end: End, why: str) -> None:
        """Ends an attempt at an episode; the scheduler decides whether it is driven again from its seed."""
        self._end(lease, why)
        lease.episode.process.kill(Outcome(end, why))

    def sweep(self) -> None:
        """Ends leases and workers that have been silent for too long; called every `SWEEP_S`."""
        now = self._clock.monotonic()
        self._forget()
        for lease in [one for one in self._leases.values() if not one.ended]:
            if lease.moving is not None:
                longest_s = max(LONGEST_TICK_S, SLOWEST_PACE * lease.episode.order.decision_s)
                if now - lease.moving > longest_s:
                    self._lose(lease, End.FAILED, f"the simulation took longer than {longest_s:g} s for one tick")
            elif lease.refused and now > lease.due:
                self._time_out(lease)
            elif now - lease.heard > self.lease_ttl_s:
                self._lose(lease, End.WORKER_GONE, f"the worker was not heard of for {self.lease_ttl_s:g} s")
        for episode in list(self._offers):
            if episode.offered is not None and now - episode.offered > self.lease_ttl_s:
                episode.process.kill(Outcome(End.UNCLAIMED, "no worker came for the episode"))

    def drain(self) -> None:
        """Stops leasing episodes; workers learn of it with their next step."""
        self.draining = True
        for _, given in list(self._polls):
            given.cancel()

    def _forget(self) -> None:
        now = self._clock.monotonic()
        for worker in [one for one in self._workers.values() if not one.leases and not one.polls]:
            if now - worker.seen > FORGET_S:
                del self._workers[worker.id], self._tokens[worker.token]
        for lease in [one for one in self._leases.values() if one.ended and now - one.heard > FORGET_S]:
            del self._leases[lease.id]
