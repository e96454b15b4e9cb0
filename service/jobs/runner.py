"""Runner: does queued jobs, a few at once, in fair turns between their owners.

A job's work is in a thread of its own, never in those that answer requests. One owner holds all places but one at most,
so that another owner's first job need not wait for the first owner's last.
"""

from __future__ import annotations

import asyncio
import logging
import shutil
import time
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from datetime import timedelta
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sqlalchemy.exc import SQLAlchemyError
from sqlalchemy.orm import Session

from dohyo.service.database.base import now
from dohyo.service.database.patience import PatientDatabase
from dohyo.service.errors import BusyError, problem_document
from dohyo.service.jobs import queries
from dohyo.service.jobs.kind import Kind, Made, Task
from dohyo.service.jobs.model import Job, JobStatus
from dohyo.service.periodic import ended
from dohyo.service.scheduling.turns import Turns
from dohyo.sumo_networks.errors import InvalidInputError

if TYPE_CHECKING:
    from dohyo.service.database.engine import Database
    from dohyo.service.settings import Settings
    from dohyo.service.state import Broadcast, Services

LOOK_S = 5.0  # longest time between two looks at the queue
CLEAN_S = 3600.0
CLOSE_S = 5.0  # for the work to end after it was told to
MOST_STARTS = 3

logger = logging.getLogger("dohyo.jobs")


class JobRunner:
    """Runs queued jobs until the service ends."""

    def __init__(self, settings: Settings, database: Database, events: Broadcast) -> None:
        """Creates the runner; `start` starts it."""
        self._settings, self._database, self._events = settings, PatientDatabase(database), events
        self._threads = ThreadPoolExecutor(settings.jobs, "job")
        self._live: dict[str, tuple[Task, asyncio.Task[None]]] = {}
        self._turns = Turns()
        self._kinds: Mapping[str, Kind] = {}
        self._services: Services | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._woken = asyncio.Event()
        self._serving: asyncio.Task[None] | None = None
        self._tasks: list[asyncio.Task[None]] = []
        self._stopped = False

    async def start(self, services: Services, kinds: Mapping[str, Kind]) -> None:
        """Recovers the jobs that an earlier service left, then starts."""
        self._services, self._kinds, self._loop = services, kinds, asyncio.get_running_loop()
        await self._database.change(self._recover)
        await self._sweep()
        self._serving = asyncio.create_task(self._serve())
        self._tasks = [asyncio.create_task(self._clean())]

    async def stop(self) -> None:
        """Ends all work; jobs that can be repeated return to the queue."""
        self._stopped = self._database.stopped = True
        self._woken.set()
        if self._serving is not None:
            await asyncio.wait([self._serving])  # the job that it is taking runs from then on, too
        for task in self._tasks:
            task.cancel()
        for work, _ in self._live.values():
            work.stop.set()
        await ended(self._tasks, logger)
        if self._live:
            await asyncio.wait([doing for _, doing in self._live.values()], timeout=CLOSE_S)
        self._threads.shutdown(wait=False, cancel_futures=True)

    def wake(self) -> None:
        """Schedules a look at the queue; callable from any thread."""
        if self._loop is not None and not self._loop.is_closed():
            self._loop.call_soon_threadsafe(self._woken.set)

    async def cancel(self, job_id: str) -> None:
        """Cancels a job: its work is told to end, and its result will not count."""
        changed = await self._database.change(lambda session: queries.cancel(session, job_id))
        if changed:
            self._tell(job_id)
        if job_id in self._live:
            self._live[job_id][0].stop.set()
        else:
            await asyncio.to_thread(self._discard, job_id)

    async def _serve(self) -> None:
        while not self._stopped:
            self._woken.clear()
            try:
                while not self._stopped and (job := await self._take()) is not None:
                    self._begin(job)
            except (SQLAlchemyError, OSError) as error:
                logger.warning("the queue of jobs cannot be read: %s", error)
            try:
                await asyncio.wait_for(self._woken.wait(), LOOK_S)
            except TimeoutError:
                continue

    async def _take(self) -> Job | None:
        """The next job for a free place."""
        if len(self._live) >= self._settings.jobs:
            return None
        most = max(1, self._settings.jobs - 1)
        heads = await self._database.read(lambda session: list(queries.first_of_each_owner(session)), patient=False)
        candidates = [job for job in heads if self._turns.running[job.owner] < most]
        while candidates:
            chosen = self._turns.next(candidates)
            # A refusal waits for the next look, since the end of the service waits for this one.
            if await self._database.change(partial(queries.start, job_id=chosen.id), patient=False):
                return chosen
            candidates.remove(chosen)  # cancelled meanwhile
        return None

    def _begin(self, job: Job) -> None:
        assert self._services is not None
        self._turns.begin(job.owner)
        work = Task(job.id, job.owner, job.arguments, upload_path(self._settings, job.id), self._services)
        self._live[job.id] = work, asyncio.create_task(self._do(job, work))
        self._tell(job.id)

    async def _do(self, job: Job, work: Task) -> None:
        began = time.monotonic()
        try:
            # A cancellation before `_live` had the job could not stop the work.
            if await self._database.read(lambda session: _runs(session, job.id)):
                outcome = await self._outcome(job, work)
                await self._end(job, work, outcome)
            else:
                await asyncio.to_thread(self._discard, job.id)
        except Exception:  # an error here must not hold the place for ever
            logger.exception("job %s (%s of %s)", job.id, job.kind, job.owner)
        finally:
            seconds = time.monotonic() - began
            self._turns.end(job.owner, seconds)
            del self._live[job.id]
            self._woken.set()
            logger.info("job %s (%s of %s) ended after %.1f s", job.id, job.kind, job.owner, seconds)

    async def _outcome(self, job: Job, work: Task) -> Made | dict[str, Any]:
        """Result of the work, or the problem that it failed with."""
        kind = self._kinds.get(job.kind)
        if kind is None:
            return problem_document(InvalidInputError(f"this version of the service has no jobs of kind '{job.kind}'"))
        doing = asyncio.get_running_loop().run_in_executor(self._threads, kind.run, work)
        ended, _ = await asyncio.wait({doing}, timeout=kind.limit_s)
        if not ended:
            logger.warning("job %s (%s of %s) is ended: over %g s", job.id, job.kind, job.owner, kind.limit_s)
            work.stop.set()
            await asyncio.wait({doing})  # the place is free only when the work has really ended
            return problem_document(InvalidInputError(f"it took longer than {kind.limit_s:g} s"))
        try:
            return doing.result()
        except Exception as error:  # whatever it is, it ends only this job
            return problem_document(error, job.id)

    async def _end(self, job: Job, work: Task, outcome: Made | dict[str, Any]) -> None:
        """Stores the outcome; work that was cut off by the end of the service is repeated by the next one."""
        if isinstance(outcome, Made):
            await self._database.change(lambda session: queries.finish(session, job.id, outcome))
        elif self._stopped and self._kinds[job.kind].repeatable:
            await self._database.change(lambda session: queries.requeue(session, job.id))
            return
        else:
            why = problem_document(_died(job.starts + 1)) if self._stopped else outcome
            await self._database.change(lambda session: queries.fail(session, job.id, why))
        self._tell(job.id)
        await asyncio.to_thread(self._discard, job.id)

    def _tell(self, job_id: str) -> None:
        self._events.publish(f"job:{job_id}", {"job": job_id})

    def _discard(self, job_id: str) -> None:
        shutil.rmtree(upload_path(self._settings, job_id).parent, ignore_errors=True)

    def _recover(self, session: Session) -> None:
        """Queues jobs again that ran when the service died, unless they may be why it died."""
        for job in queries.running(session):
            kind = self._kinds.get(job.kind)
            if kind is not None and kind.repeatable and job.starts < MOST_STARTS:
                queries.queue_again(session, job.id)
            else:
                logger.warning("job %s (%s of %s) is not repeated", job.id, job.kind, job.owner)
                queries.fail(session, job.id, problem_document(_died(job.starts)))

    async def _sweep(self) -> None:
        """Deletes finished jobs after their time, and files of jobs that have ended."""

        def forget(session: Session) -> set[str]:
            queries.delete_before(session, now() - timedelta(days=self._settings.jobs_kept_days))
            return queries.unfinished(session)

        await asyncio.to_thread(self._delete_uploads, await self._database.change(forget, patient=False))

    def _delete_uploads(self, wanted: set[str]) -> None:
        for folder in self._settings.uploads.glob("job-*"):
            if folder.name not in wanted and folder.stat().st_mtime < time.time() - CLEAN_S:
                shutil.rmtree(folder, ignore_errors=True)

    async def _clean(self) -> None:
        while True:
            await asyncio.sleep(CLEAN_S)
            try:
                await self._sweep()
            except (SQLAlchemyError, OSError) as error:
                logger.warning("old jobs cannot be deleted: %s", error)


def upload_path(settings: Settings, job_id: str) -> Path:
    """Path of a job's uploaded file."""
    return settings.uploads / job_id / "file"


def _runs(session: Session, job_id: str) -> bool:
    job = queries.find_job(session, job_id)
    return job is not None and job.status is JobStatus.RUNNING


def _died(starts: int) -> BusyError:
    return BusyError(f"the service stopped {starts} times while it ran; order it again", retry_s=60)
