"""Scheduler: takes queued episodes in fair turns between owners, drives them, and stores their results.

One task per live episode. The database and the disk are touched in threads only, so that no worker's step waits for
them. After an interruption, even by kill -9, the next start keeps complete records in staging and drives all other
episodes again.
"""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Any

from sqlalchemy.exc import SQLAlchemyError

from dohyo.evaluation.records.specifications import Status
from dohyo.service.database.patience import PatientDatabase
from dohyo.service.periodic import ended
from dohyo.service.running.order import EpisodeOrder
from dohyo.service.running.process import End, EpisodeProcess, Outcome
from dohyo.service.scheduling import queue
from dohyo.service.scheduling.dismissal import dismiss_workers
from dohyo.service.scheduling.orders import Orders
from dohyo.service.scheduling.queue import Next, Ticket, Waiting
from dohyo.service.scheduling.recovery import recover
from dohyo.service.scheduling.results import DRAINED, OUTCOMES, Results
from dohyo.service.scheduling.turns import Turns
from dohyo.service.settings import Settings
from dohyo.service.shielding import to_the_end
from dohyo.service.storage.usage import EpisodeCheck
from dohyo.service.submissions.model import AgentKind
from dohyo.service.workers.lease import RemoteEpisode
from dohyo.service.workers.leases import SWEEP_S, LeaseBook
from dohyo.service.workers.loop_clock import LoopClock
from dohyo.sumo_networks.errors import DohyoError

if TYPE_CHECKING:
    from dohyo.service.database.engine import Database
    from dohyo.service.state import Broadcast

LOOK_S = 2.0  # longest time between two looks at the queue
RETRY_S = 1.0  # pause after a look that failed
ABORT_S = 10.0  # longest wait for the end of cancelled drives
USED_UP = "the worker left the episode, for which its submission has no attempt left"

logger = logging.getLogger("dohyo.scheduler")


@dataclass(eq=False, slots=True)
class Live:
    """A running episode.

    Attributes:
        ticket: Ticket of the episode.
        task: Task that drives it.
        remote: The remote episode, where a worker drives.
        processor_s: Processor time of the attempt so far, s.
        began: When it was taken, of the monotonic clock, s.
    """

    ticket: Ticket
    task: asyncio.Task[None] | None = None
    remote: RemoteEpisode | None = None
    processor_s: float = 0.0
    began: float = field(default_factory=time.monotonic)

    @property
    def unclaimed(self) -> bool:
        """Whether it waits for a worker."""
        return self.ticket.waiting.kind is AgentKind.REMOTE and (self.remote is None or not self.remote.held)


class Scheduler:
    """Drives queued episodes.

    Attributes:
        leases: Lease book of the policy workers.
    """

    def __init__(self, settings: Settings, database: Database, events: Broadcast) -> None:
        """Creates the scheduler; `start` starts it."""
        self._clock = LoopClock()
        self.leases = LeaseBook(settings.lease_ttl_s, self._clock)
        self.leases.fresh = self.wake
        self._settings, self._database, self._orders = settings, PatientDatabase(database), Orders(settings)
        self._results = Results(settings, self._database, events, self._orders)
        self._cluster = settings.ray_address if settings.executor == "ray" else None
        self._live: dict[str, Live] = {}
        self._idle: list[EpisodeProcess] = []
        self._turns = Turns()
        self._usage = EpisodeCheck(settings.bytes_per_owner)
        self._woken = asyncio.Event()
        self._serving: asyncio.Task[None] | None = None
        self._tasks: list[asyncio.Task[None]] = []
        self._draining = self._stopped = False
        self._queued = 0

    # Life

    async def start(self) -> None:
        """Recovers what an earlier service left unfinished, then starts."""
        await recover(self._database, self._orders, self._results)
        self._serving = asyncio.create_task(self._serve())
        always = (self._sweep(), dismiss_workers(self._database, self.leases))
        self._tasks = [asyncio.create_task(one) for one in always]

    def wake(self) -> None:
        """Schedules a look at the queue: an evaluation was created or resumed, or a worker waits."""
        self._woken.set()

    def begin_drain(self) -> None:
        """Starts no more episodes; workers learn of it with their next step."""
        self._draining = True
        self.leases.drain()
        self.wake()

    async def drain(self) -> None:
        """Waits until running episodes have ended, for `drain_s` at most."""
        self.begin_drain()
        if self._serving is not None:
            await asyncio.wait([self._serving])  # the episode that it is taking runs from then on, too
        _cancel(_tasks(live for live in self._live.values() if live.unclaimed))
        if tasks := _tasks(self._live.values()):
            await asyncio.wait(tasks, timeout=self._settings.drain_s)

    async def stop(self) -> None:
        """Drains and ends all processes; unfinished episodes return to the queue without counting an attempt."""
        if self._stopped:
            return
        await self.drain()
        self._stopped = self._database.stopped = True
        tasks = [*self._tasks, *_tasks(self._live.values())]
        _cancel(tasks)
        await ended(tasks, logger)
        await asyncio.gather(*(process.close() for process in self._idle))
        self._idle.clear()

    async def cancel(self, evaluation_id: str) -> None:
        """Cancels an evaluation: running episodes stop at once, finished ones are kept.

        An attempt that a worker drives counts against the submission: a cancelled drive is no free second try.
        """
        driven = self._driven()
        progress = await self._database.change(
            lambda session: queue.cancel(session, evaluation_id, driven), patient=False
        )
        if progress is not None:
            await self._abort(evaluation_id)
            await self._results.tell(progress)

    def snapshot(self) -> dict[str, Any]:
        """Counts of running and waiting episodes, workers and leases."""
        remote = sum(one.ticket.waiting.kind is AgentKind.REMOTE for one in self._live.values())
        return {
            "running": len(self._live),
            "running_remote": remote,
            "queued": self._queued,
            "processes": len(self._live) + len(self._idle),
            **self.leases.counts(),
            "draining": self._draining,
        }

    # The queue

    async def _serve(self) -> None:
        while not self._draining:
            self._woken.clear()
            try:
                await self._requeue_undriven()
                while not self._draining and (ticket := await self._take()) is not None:
                    live = self._live[ticket.episode_id] = Live(ticket)
                    self._turns.begin(ticket.waiting.owner)
                    live.task = asyncio.create_task(self._drive(live))
                    live.task.add_done_callback(partial(self._over, live))
            except (SQLAlchemyError, OSError) as error:
                logger.warning("the queue cannot be read: %s", error)
                await asyncio.sleep(RETRY_S)
            try:
                await asyncio.wait_for(self._woken.wait(), LOOK_S)
            except TimeoutError:
                continue

    async def _requeue_undriven(self) -> None:
        """Requeues running episodes that no task drives: they were taken, but the answer to the commit was lost.

        Only the task that takes episodes can know that nobody is about to drive them.
        """
        live = list(self._live)
        for key in await self._database.read(lambda session: queue.undriven(session, live), patient=False):
            logger.warning("episode %s is running, but nobody drives it: it is queued again", key.episode_id)
            await self._database.change(partial(queue.requeue, key=key, ended=DRAINED), patient=False)

    async def _take(self) -> Ticket | None:
        """The next episode for a free process or worker; none whose cancelled drive has not ended yet."""
        live = list(self._live)
        candidates, self._queued = await self._database.read(
            lambda session: (queue.waiting(session, live), queue.queued_count(session)), patient=False
        )
        can_start = [one for one in candidates if self._has_room(one)]
        if not can_start:
            return None
        chosen = self._turns.next(can_start)
        # A refusal waits for the next look, since a drain waits for this one.
        return await self._database.change(lambda session: queue.take(session, chosen, live), patient=False)

    def _has_room(self, one: Waiting) -> bool:
        """Whether a process is free for an evaluation, and a worker wants it.

        An owner of whom nothing runs may begin in one process more than there are, so that it never waits for the end
        of another owner's long episode.
        """
        is_remote = one.kind is AgentKind.REMOTE
        alike = [live for live in self._live.values() if (live.ticket.waiting.kind is AgentKind.REMOTE) == is_remote]
        newcomer = all(live.ticket.waiting.owner != one.owner for live in alike)
        places = (self._settings.remote_episodes if is_remote else self._settings.processes) + newcomer
        return len(alike) < places and (not is_remote or self._wanted(one))

    def _wanted(self, one: Waiting) -> bool:
        """Whether more workers wait for a submission's episodes than episodes are on offer."""
        coming = sum(
            live.unclaimed and (live.ticket.waiting.agent, live.ticket.waiting.version) == (one.agent, one.version)
            for live in self._live.values()
        )
        return self.leases.demand(one.agent, one.version) > coming

    # One episode

    async def _drive(self, live: Live) -> None:
        ticket = live.ticket
        try:
            await self._drive_to_an_end(live)
        except asyncio.CancelledError:
            # Cancelled with its evaluation or by our shutdown; only in the second case does it still count as running.
            await self._results.requeue(ticket)
        except Exception:  # an internal error must not leave the episode running for ever
            logger.exception("episode %s", ticket.episode_id)
            failed = Outcome(End.FAILED, "an error of the service; its log tells more")
            await self._results.give_up(ticket, failed, live.processor_s)

    def _over(self, live: Live, _: asyncio.Task[None]) -> None:
        """Frees the place of an episode; of a task that was cancelled before its first step no line has run."""
        del self._live[live.ticket.episode_id]
        # An agent that sleeps holds a process, and one with many threads uses more than one processor.
        self._turns.end(live.ticket.waiting.owner, max(live.processor_s, time.monotonic() - live.began))
        self.wake()

    async def _drive_to_an_end(self, live: Live) -> None:
        ticket = live.ticket
        self._results.publish(ticket, "running")
        try:
            # An evaluation whose owner keeps too much fails; it can be resumed after a deletion.
            await self._database.read(partial(self._usage.check, owner=ticket.waiting.owner))
            order = await asyncio.to_thread(self._orders.make, ticket)
        except DohyoError as error:
            await self._fail(ticket, str(error))
            return
        outcome = Outcome(End.HUNG, USED_UP) if ticket.used_up else await self._in_process(order, live)
        while (following := _without_culprit(order, outcome)) is not None:
            outcome, order = await self._in_process(following, live), following
        if outcome.end in OUTCOMES:
            if await self._results.give_up(ticket, outcome, live.processor_s) is not Next.AGENT_FAULT:
                return
            outcome = Outcome(End.HUNG, f"{USED_UP}; the last: {outcome.text}")
        if outcome.end is End.HUNG:
            verdict = (Status.AGENT_DEADLINE, outcome.text)
            outcome = await self._in_process(order.model_copy(update={"verdict": verdict, "remote": False}), live)
        if outcome.end is End.FINISHED:
            outcome = await to_the_end(self._results.keep(ticket, order, live.processor_s))
        if outcome.end is End.IMPOSSIBLE:
            await self._fail(ticket, outcome.text)
        elif outcome.end is not End.FINISHED:
            await self._results.give_up(ticket, outcome, live.processor_s)

    async def _in_process(self, order: EpisodeOrder, live: Live) -> Outcome:
        """Drives an order in a process, which is then kept for the next one."""
        try:
            process = await self._process()
        except OSError as error:
            return Outcome(End.DIED, f"no process could be started: {error}")
        began_s = process.processor_s
        outcome = aborted = Outcome(End.STOPPED, "its evaluation has ended, or the service")
        try:
            if order.remote:
                waiting, attempt = live.ticket.waiting, live.ticket.attempt
                live.remote = RemoteEpisode(waiting.agent, waiting.version, attempt, order, process)
                self.leases.expect(live.remote)
            outcome = await process.drive(order, self._settings.episode_limit_s)
        finally:
            live.processor_s += process.processor_s - began_s
            if order.remote and live.remote is not None:
                self.leases.ended(live.remote, outcome, "run" if outcome is not aborted else "abort")
            if process.alive and not self._stopped and len(self._idle) < self._settings.processes:
                self._idle.append(process)
            else:
                process.kill()
                await to_the_end(process.close())
        return outcome

    async def _process(self) -> EpisodeProcess:
        while self._idle:
            process = self._idle.pop()
            if process.alive:
                return process
        process = EpisodeProcess(self._settings.policies, cluster=self._cluster)
        await process.start()
        return process

    async def _fail(self, ticket: Ticket, why: str) -> None:
        """Fails an evaluation that cannot be driven, such as one whose owner has filled the disk to end bad drives."""
        logger.warning("evaluation %s cannot be driven: %s", ticket.evaluation_id, why)
        driven = self._driven()
        progress = await self._database.change(lambda session: queue.fail(session, ticket, why, driven))
        if progress is not None:
            await self._abort(ticket.evaluation_id, but=ticket.episode_id)
            await self._results.tell(progress, ticket, "cancelled")

    def _driven(self) -> list[str]:
        """Identifiers of episodes whose attempt counts against the submission if its owner ends it now."""
        return [
            one.ticket.episode_id
            for one in self._live.values()
            if one.remote is not None and self.leases.is_costly(one.remote)
        ]

    async def _abort(self, evaluation_id: str, but: str = "") -> None:
        """Ends the drives of an evaluation, and waits for their end: until then they write to its staging."""
        of_it = [live for live in self._live.values() if live.ticket.evaluation_id == evaluation_id]
        if tasks := _tasks(live for live in of_it if live.ticket.episode_id != but):
            _cancel(tasks)
            await asyncio.wait(tasks, timeout=ABORT_S)

    async def _sweep(self) -> None:
        while True:
            await asyncio.sleep(SWEEP_S)
            self._clock.tick()
            self.leases.sweep()


def _tasks(lives: Iterable[Live]) -> list[asyncio.Task[None]]:
    return [live.task for live in lives if live.task is not None]


def _cancel(tasks: Iterable[asyncio.Task[None]]) -> None:
    """Cancels tasks once: one that is cancelled may be returning its episode, and a second time cuts that off."""
    for task in tasks:
        if not task.cancelling():
            task.cancel()


def _without_culprit(order: EpisodeOrder, outcome: Outcome) -> EpisodeOrder | None:
    """What to drive next in a mixed run whose process an agent has ended; None: nobody can be blamed, or nobody is."""
    if outcome.end is End.HUNG:
        return order.without(outcome.ego, outcome.text)
    return order.after_death(outcome.ego) if outcome.in_call else None
