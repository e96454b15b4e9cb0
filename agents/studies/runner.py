"""Runner: runs the cells of a study over processes, and appends a row per cell; the same call resumes.

A row is on the disk before the next job begins. A cell whose simulation failed or whose process died is a row that says
so, and the next call runs it again. An error keeps the rows that its job had before. Jobs that need the same training
never train it at the same time.
"""

from __future__ import annotations

import json
import os
import signal
import threading
import traceback
from collections.abc import Callable, Collection, Hashable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing import active_children
from pathlib import Path
from types import FrameType
from typing import NamedTuple

from dohyo.agents.studies.arms import Cell
from dohyo.agents.studies.rows import Row, cell_of, read_rows
from dohyo.evaluation.running.lock import held
from dohyo.sumo_networks.errors import DohyoError, SimulationError
from dohyo.sumo_networks.files import write_atomically
from dohyo.sumo_networks.processes import worker_pool

Job = Sequence[Cell]
Work = Callable[[Job], Iterable[Row]]
Progress = Callable[[int, int, Job], None]
Trainings = Callable[[Cell], Collection[str]]
"""Names of the trainings that the work on a cell begins, unless they are done."""
NOTHING, DIED = "the work returned no row", "the process died"


class Found(NamedTuple):
    """What the work on a job gave.

    Attributes:
        rows: Of its cells.
        lost: Why the other cells have none; "" where the work has ended.
    """

    rows: Sequence[Row]
    lost: str = ""


def run(
    path: Path,
    cells: Iterable[Cell],
    work: Work,
    *,
    workers: int = 1,
    together: Callable[[Cell], Hashable] = lambda cell: cell,
    trainings: Trainings = lambda cell: (),
    fresh: bool = False,
    progress: Progress = lambda done, total, job: None,
) -> None:
    """Runs the missing cells.

    Args:
        path: File of the rows.
        cells: Wanted cells.
        work: Measures of the cells of one job, a row each; a row needs only its measures and the fields of its cell
            that differ within the job. Must be picklable if there are processes.
        workers: Number of processes; 1: this process.
        together: Key of the job of a cell; by default each cell is a job.
        trainings: Of a cell. One job at a time works on a training that is not done; the others that need it wait.
        fresh: Whether each job gets a process of its own, since it leaves global state behind.
        progress: Called with the number of cells that have a row, their total, and the job that has just ended.

    Raises:
        InvalidInputError: Another process writes to the same folder, or the work cannot be done at all. Jobs that were
                running end first, and have their rows.
    """
    wanted = list(dict.fromkeys(cells))
    with held(path.parent, "study"):
        kept = [row for row in read_rows(path) if "lost" not in row or cell_of(row) not in wanted]
        write_atomically(path, _lines(kept))
        there = {cell_of(row) for row in kept}
        jobs: dict[Hashable, list[Cell]] = {}
        for cell in wanted:
            if cell not in there:
                jobs.setdefault(together(cell), []).append(cell)
        done = len(wanted) - sum(map(len, jobs.values()))
        with path.open("ab") as file, _stopped_by_sigterm():
            for job, found in _worked(_Queue(jobs.values(), trainings), work, workers, fresh):
                file.write(_lines(_rows(job, found)))
                file.flush()
                os.fsync(file.fileno())
                done += len(job)
                progress(done, len(wanted), job)


def _rows(job: Job, found: Found) -> Iterator[Row]:
    """A row per cell of a job; a lost one where the work gave none."""
    shared = job[0]._asdict()
    measured = {cell_of(row): row for row in ({**shared, **row} for row in found.rows)}
    for cell in job:
        yield measured.get(cell) or _lost(cell, found.lost or NOTHING)


def _lost(cell: Cell, why: str) -> Row:
    return {**cell._asdict(), "lost": why}


def row_each(job: Job, measure: Callable[[Cell], Row]) -> Iterator[Row]:
    """A row per cell of a job, for works whose cells do not depend on each other: a failed simulation loses its cell.

    Args:
        job: The cells.
        measure: Row of a cell.
    """
    for cell in job:
        try:
            row = measure(cell)
        except SimulationError as error:
            row = _lost(cell, _told(error))
        yield row


def _lines(rows: Iterable[Row]) -> bytes:
    return "".join(json.dumps(row) + "\n" for row in rows).encode()


class _Queue:
    """Jobs that have not begun, in order."""

    def __init__(self, jobs: Iterable[Job], trainings: Trainings) -> None:
        self.jobs = list(jobs)
        self._trainings = trainings
        self._trained: set[str] = set()

    def take(self, going: Iterable[Job]) -> Job | None:
        """Removes the first job that may begin beside those that are going on; None: all that are left must wait."""
        busy = {name for job in going for name in self._needs(job)} - self._trained
        for number, job in enumerate(self.jobs):
            if busy.isdisjoint(self._needs(job)):
                return self.jobs.pop(number)
        return None

    def note(self, job: Job, found: Found) -> None:
        """Takes the trainings of a job that has ended as done, unless it ended early: it may have been in one."""
        if not found.lost:
            self._trained |= self._needs(job)

    def _needs(self, job: Job) -> set[str]:
        return {name for cell in job for name in self._trainings(cell)}


def _worked(queue: _Queue, work: Work, workers: int, fresh: bool) -> Iterator[tuple[Job, Found]]:
    """Each job with its rows, or with the reason why cells were lost, as they end."""
    if workers == 1 and not fresh:
        yield from ((job, _attempt(work, job)) for job in queue.jobs)
        return
    suspects = list[Job]()
    while queue.jobs:
        yield from _until_a_process_dies(queue, suspects, work, workers, fresh)
    for job in suspects:  # alone, so that none is lost because of another
        with _pool(1, fresh) as pool:
            try:
                yield job, pool.submit(_attempt, work, job).result()
            except BrokenProcessPool:
                yield job, Found((), DIED)


def _until_a_process_dies(
    queue: _Queue, suspects: list[Job], work: Work, workers: int, fresh: bool
) -> Iterator[tuple[Job, Found]]:
    """Jobs as they end; those that were running when a process died become suspects; an error ends the queue."""
    going: dict[Future[Found], Job] = {}
    broken, stopped_by = False, None
    with _pool(workers, fresh) as pool:
        while (queue.jobs or going) and not broken:
            # No more are submitted than there are workers: a broken pool loses all that it was given.
            while len(going) < workers and not broken and (job := queue.take(going.values())):
                try:
                    going[pool.submit(_attempt, work, job)] = job
                except BrokenProcessPool:  # it died between two jobs
                    queue.jobs.insert(0, job)
                    broken = True
            for future in wait(going, timeout=0 if broken else None, return_when=FIRST_COMPLETED).done:
                error = future.exception()
                if isinstance(error, BrokenProcessPool):
                    broken = True
                elif error is not None:  # the jobs beside it end first, since their rows may be hours of work
                    stopped_by = stopped_by or error
                    queue.jobs.clear()
                    going.pop(future)
                else:
                    job, found = going.pop(future), future.result()
                    queue.note(job, found)
                    yield job, found
    if stopped_by is not None:
        raise stopped_by
    suspects += going.values()


def _attempt(work: Work, job: Job) -> Found:
    """Rows of a job, and the reason why it ended early; errors of the input stop the study."""
    rows = list[Row]()
    try:
        rows.extend(work(job))  # keeps the rows from before an error
    except SimulationError as error:
        return Found(rows, _told(error))
    except DohyoError:
        raise
    except Exception as error:  # an error of dohyo itself: the study goes on, and the row states it
        traceback.print_exc()
        return Found(rows, _told(error))
    return Found(rows)


def _told(error: Exception) -> str:
    return f"{type(error).__name__}: {error}"


@contextmanager
def _pool(workers: int, fresh: bool) -> Iterator[ProcessPoolExecutor]:
    pool = worker_pool(workers, _attempt, max_tasks_per_child=1 if fresh else None)
    try:
        yield pool
    finally:
        pool.shutdown(cancel_futures=True)


@contextmanager
def _stopped_by_sigterm() -> Iterator[None]:
    """Forwards SIGTERM, which unlike Ctrl-C reaches only this process, to the workers, and ends the block."""

    def stop(number: int, frame: FrameType | None) -> None:
        for child in active_children():
            child.terminate()
        raise KeyboardInterrupt

    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGTERM, stop)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)
