"""Results: the end of each attempt is stored, and told to those who follow the evaluation."""

from __future__ import annotations

import asyncio
import logging
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dohyo.service.database.patience import PatientDatabase
from dohyo.service.episodes.archive import Record, discard, ensure_archived, lost_because, record_size, shelve
from dohyo.service.evaluations.model import AttemptOutcome
from dohyo.service.running.order import EpisodeOrder
from dohyo.service.running.process import End, Outcome
from dohyo.service.scheduling import queue
from dohyo.service.scheduling.attempts import AttemptEnd
from dohyo.service.scheduling.orders import Orders
from dohyo.service.scheduling.queue import Next, Progress, Ticket
from dohyo.service.settings import Settings
from dohyo.service.storage.deletion import remove_records
from dohyo.service.submissions.model import AgentKind
from dohyo.sumo_networks.errors import InvalidInputError

if TYPE_CHECKING:
    from dohyo.service.state import Broadcast

OUTCOMES = {
    End.FAILED: AttemptOutcome.SIMULATION,
    End.DIED: AttemptOutcome.MACHINE,
    End.WORKER_GONE: AttemptOutcome.WORKER_GONE,
    End.GIVEN_BACK: AttemptOutcome.GIVEN_BACK,
    End.UNCLAIMED: AttemptOutcome.UNCLAIMED,
}
"""Outcomes of attempts that gave no record, by the end of the drive."""
DRAINED = AttemptEnd(AttemptOutcome.DRAINED)

logger = logging.getLogger("dohyo.scheduler")


class Results:
    """Stores and tells the ends of attempts."""

    def __init__(self, settings: Settings, database: PatientDatabase, events: Broadcast, orders: Orders) -> None:
        """Begins."""
        self._settings, self._database, self._events, self._orders = settings, database, events, orders

    async def keep(self, ticket: Ticket, order: EpisodeOrder, processor_s: float) -> Outcome:
        """Archives a finished record; a fault after which driving again may end otherwise is not a result.

        Not to be cut off: a record in the archive that no episode names would stay there for ever.
        """
        staged = order.directory / f"{order.stem}.json"
        try:
            record = await asyncio.to_thread(shelve, self._settings, staged, order.scenario)
        except InvalidInputError as error:
            return Outcome(End.FAILED, str(error))
        except OSError as error:
            return Outcome(End.FAILED, f"the record cannot be kept: {error}")
        lost = lost_because(record)
        if lost is None:
            await self._remember(ticket, staged, record, processor_s)
        await asyncio.to_thread(discard, self._settings, ticket.evaluation_id, ticket.stem)
        return Outcome(End.FINISHED) if lost is None else Outcome(End.FAILED, lost)

    async def _remember(self, ticket: Ticket, staged: Path, record: Record, processor_s: float) -> None:
        from dohyo.service.evaluations.scoring import is_agent_fault, summary_at

        failed = is_agent_fault(record)
        ended = AttemptEnd(AttemptOutcome.AGENT_FAILED if failed else AttemptOutcome.DONE, processor_s=processor_s)
        summary = await asyncio.to_thread(summary_at, staged, record, ticket.document.get("rules", "2.0"))
        kept = await asyncio.to_thread(record_size, staged)
        progress = await self._database.change(
            lambda session: queue.finish(session, ticket, record.record_hash, summary, ended, kept)
        )
        await asyncio.to_thread(ensure_archived, self._settings, staged, record)
        if progress is None:  # cancelled meanwhile; an equal record of another episode stays
            await self._database.use(lambda database: remove_records(self._settings, database, [record.record_hash]))
        await self.tell(progress, ticket, "done")

    async def give_up(self, ticket: Ticket, outcome: Outcome, processor_s: float) -> Next:
        """Ends an attempt without a record, and does what follows from the attempts so far."""
        why = outcome.text
        ended = AttemptEnd(OUTCOMES.get(outcome.end, AttemptOutcome.SIMULATION), why, processor_s)
        logger.warning("episode %s, attempt %d, %s: %s", ticket.episode_id, ticket.attempt, ended.outcome, why)
        deaths = self._settings.process_deaths
        what_next, progress = await self._database.change(lambda session: queue.give_up(session, ticket, ended, deaths))
        if what_next is Next.AGAIN:
            self.publish(ticket, "queued")
        elif what_next is Next.LOST:
            logger.error("episode %s is lost: %s", ticket.episode_id, why)
            await self.tell(progress, ticket, "lost")
        return what_next

    async def requeue(self, ticket: Ticket) -> None:
        """Returns an episode to the queue without counting an attempt."""
        await self._database.change(lambda session: queue.requeue(session, ticket.key, DRAINED))

    def publish(self, ticket: Ticket, status: str, progress: Progress | None = None) -> None:
        """Tells the followers of an evaluation about one of its episodes."""
        data: dict[str, Any] = {"episode": ticket.episode_id, "status": status}
        if ticket.waiting.kind is AgentKind.REMOTE and status != "done":
            del data["episode"]  # a worker would learn which scenario it drives
        if progress is not None:
            data |= {"done": progress.done, "total": progress.total}
        self._events.publish(f"evaluation:{ticket.evaluation_id}", data)

    async def tell(self, progress: Progress | None, ticket: Ticket | None = None, status: str = "") -> None:
        """Publishes the progress; removes the staging of an ended evaluation."""
        if progress is None:
            return
        if ticket is not None:
            self.publish(ticket, status, progress)
        if not progress.ended:
            return
        data = {"evaluation": progress.evaluation_id, "status": progress.status.value}
        counts = {"done": progress.done, "total": progress.total}
        self._events.publish(f"evaluation:{progress.evaluation_id}", data | counts)
        self._events.publish("evaluations", data)
        self._orders.forget(progress.evaluation_id)
        await asyncio.to_thread(discard, self._settings, progress.evaluation_id)
