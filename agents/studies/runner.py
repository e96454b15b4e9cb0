"""Runner: runs the cells of a study over processes, and appends a row per cell; the same call resumes.

A row is on the disk before the next job begins. A cell whose simulation failed or whose process died is a row that says
so, and the next call runs it again.
"""

from __future__ import annotations

import json
import os
import signal
import threading
import traceback
from collections import deque
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing import active_children
from pathlib import Path
from types import FrameType

from dohyo.agents.studies.arms import Cell
from dohyo.agents.studies.rows import Row, cell_of, read_rows
from dohyo.evaluation.running.lock import held
from dohyo.sumo_networks.errors import DohyoError, SimulationError
from dohyo.sumo_networks.files import write_atomically
from dohyo.sumo_networks.processes import worker_pool

Job = Sequence[Cell]
Work = Callable[[Job], Iterable[Row]]
Progress = Callable[[int, int, Job], None]
Found = list[Row] | str
"""Rows of a job, or the reason why it was lost."""
NOTHING, DIED = "the work returned no row", "the process died"


def run(
    path: Path,
    cells: Iterable[Cell],
    work: Work,
    *,
    workers: int = 1,
    together: Callable[[Cell], Hashable] = lambda cell: cell,
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
        fresh: Whether each job gets a process of its own, since it leaves global state behind.
        progress: Called with the number of cells that have a row, their total, and the job that has just ended.

    Raises:
        InvalidInputError: Another process writes to the same folder, or the work cannot be done at all.
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
            for job, found in _worked(list(jobs.values()), work, workers, fresh):
                file.write(_lines(_rows(job, found)))
                file.flush()
                os.fsync(file.fileno())
                done += len(job)
                progress(done, len(wanted), job)


def _rows(job: Job, found: Found) -> Iterator[Row]:
    """A row per cell of a job; a lost one where the work gave none."""
    shared = job[0]._asdict()
    measured: Mapping[Cell, Row] = (
        {} if isinstance(found, str) else {cell_of(row): row for row in ({**shared, **row} for row in found)}
    )
    for cell in job:
        yield measured.get(cell, {**cell._asdict(), "lost": found if isinstance(found, str) else NOTHING})


def _lines(rows: Iterable[Row]) -> bytes:
    return "".join(json.dumps(row) + "\n" for row in rows).encode()


def _worked(jobs: Sequence[Job], work: Work, workers: int, fresh: bool) -> Iterator[tuple[Job, Found]]:
    """Each job with its rows, or with the reason why it was lost, as they end."""
    if workers == 1 and not fresh:
        yield from ((job, _attempt(work, job)) for job in jobs)
        return
    waiting, suspects = deque(jobs), list[Job]()
    while waiting:
        yield from _until_a_process_dies(waiting, suspects, work, workers, fresh)
    for job in suspects:  # alone, so that none is lost because of another
        with _pool(1, fresh) as pool:
            try:
                yield job, pool.submit(_attempt, work, job).result()
            except BrokenProcessPool:
                yield job, DIED


def _until_a_process_dies(
    waiting: deque[Job], suspects: list[Job], work: Work, workers: int, fresh: bool
) -> Iterator[tuple[Job, Found]]:
    """Jobs as they end; those that were running when a process died become suspects."""
    going: dict[Future[Found], Job] = {}
    broken = False
    with _pool(workers, fresh) as pool:
        while (waiting or going) and not broken:
            # No more are submitted than there are workers: a broken pool loses all that it was given.
            while waiting and len(going) < workers and not broken:
                job = waiting.popleft()
                try:
                    going[pool.submit(_attempt, work, job)] = job
                except BrokenProcessPool:  # it died between two jobs
                    waiting.appendleft(job)
                    broken = True
            for future in wait(going, timeout=0 if broken else None, return_when=FIRST_COMPLETED).done:
                if isinstance(future.exception(), BrokenProcessPool):
                    broken = True
                else:
                    yield going.pop(future), future.result()
    suspects += going.values()


def _attempt(work: Work, job: Job) -> Found:
    """Rows of a job, or the reason why it was lost; errors of the input stop the study."""
    try:
        return list(work(job))
    except SimulationError as error:
        return f"{type(error).__name__}: {error}"
    except DohyoError:
        raise
    except Exception as error:  # an error of dohyo itself: the study goes on, and the row states it
        traceback.print_exc()
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
