"""Readers: shared state of the reading routes, and access to records and files derived from them."""

from __future__ import annotations

import contextlib
import logging
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, BinaryIO, Final, TypeVar

from fastapi import Depends, Request

from dohyo.evaluation.benchmarks.benchmark import Benchmark
from dohyo.evaluation.freeway.benchmark import ForecastBenchmark, TrafficBenchmark
from dohyo.evaluation.freeway.day import DAY, DayRecord
from dohyo.evaluation.freeway.morning import MORNING, MorningRecord
from dohyo.evaluation.parking.benchmark import LOT
from dohyo.evaluation.parking.lot_files import read_lot, read_lot_motion
from dohyo.evaluation.parking.record import ParkingRecord
from dohyo.evaluation.records.record import EpisodeRecord
from dohyo.evaluation.records.signature import Sealed
from dohyo.evaluation.records.store import read_record, read_trajectory
from dohyo.evaluation.records.trajectory import Trajectory
from dohyo.service.accounts.access import Caller
from dohyo.service.benchmarks.catalog import AnyBenchmark, read_benchmark
from dohyo.service.boards import queries as reading
from dohyo.service.boards.standings import Recent, Standings
from dohyo.service.episodes.archive import archived_path
from dohyo.service.errors import ConflictError, GoneError, NotFoundError
from dohyo.service.evaluations.access import Aspect, find_visible, require, seen_by
from dohyo.service.evaluations.model import BenchmarkVersion, Episode, Evaluation
from dohyo.service.mixed_runs.cross_play import CrossPlays
from dohyo.service.settings import Settings
from dohyo.service.state import Services, ServicesOf
from dohyo.service.submissions.model import AgentKind
from dohyo.sumo_networks.arrays import Float32Array
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.files import write_atomically

STRIPES: Final = 64
COUNTS_S: Final = 5.0

R = TypeVar("R", bound=Sealed)

logger = logging.getLogger("dohyo.service")


@dataclass(slots=True)
class Readers:
    """Shared state of the reading routes of one app.

    Attributes:
        standings: Cached leaderboards.
        cross_plays: Cached matrices of agents in mixed runs.
        benchmarks: Parsed documents by content hash.
    """

    standings: Standings
    cross_plays: CrossPlays = field(default_factory=CrossPlays)
    benchmarks: Recent[str, AnyBenchmark] = field(default_factory=lambda: Recent(50))
    _counts: tuple[float, tuple[Mapping[str, int], Mapping[str, int]]] | None = None
    _stripes: list[threading.Lock] = field(default_factory=lambda: [threading.Lock() for _ in range(STRIPES)])

    def stored(self, version: BenchmarkVersion) -> AnyBenchmark:
        """A benchmark as it was when it was evaluated."""
        benchmark = self.benchmarks.get(version.sha256)
        if benchmark is None:
            benchmark = read_benchmark(version.document)
            self.benchmarks.put(version.sha256, benchmark)
        return benchmark

    def benchmark(self, version: BenchmarkVersion) -> Benchmark:
        """The same, of a benchmark of drives.

        Raises:
            ConflictError: It is one of parking lots, freeway mornings or forecasts.
        """
        benchmark = self.stored(version)
        if not isinstance(benchmark, Benchmark):
            raise ConflictError(f"benchmark '{version.name}' has no drives on roads")
        return benchmark

    def network_of(self, version: BenchmarkVersion, cell: str) -> str:
        """Network of a benchmark's cell; empty for an unknown cell, and for lots."""
        match benchmark := self.stored(version):
            case Benchmark():
                return next((one.network for one in benchmark.cells if one.name == cell), "")
            case TrafficBenchmark() | ForecastBenchmark():
                return benchmark.network
            case _:
                return ""

    def counts(self, services: Services) -> tuple[Mapping[str, int], Mapping[str, int]]:
        """Counts of episodes and evaluations by status, at most a few seconds old."""
        now, known = time.monotonic(), self._counts
        if known is None or now - known[0] > COUNTS_S:
            with services.database.reading() as session:
                known = self._counts = now, reading.count_by_status(session)
        return known[1]

    def derived(self, path: Path, make: Callable[[], bytes]) -> bytes:
        """A derived file: read from the cache, or built and stored there. Built every time where the disk is full."""
        with self._stripes[hash(path) % STRIPES]:
            with contextlib.suppress(FileNotFoundError):
                return path.read_bytes()
            content = make()
            try:
                write_atomically(path, content)
            except OSError as error:
                logger.warning("%s cannot be kept: %s", path.name, error.strerror)
            return content


async def readers_of(request: Request, services: ServicesOf) -> Readers:
    """The app's readers, created at the first request on the event loop, so that there is only one."""
    state = request.app.state
    if not hasattr(state, "readers"):
        state.readers = Readers(Standings())
    readers: Readers = state.readers
    return readers


ReadersOf = Annotated[Readers, Depends(readers_of)]


def evaluation_for(
    services: Services, caller: Caller, evaluation_id: str, aspect: Aspect
) -> tuple[Evaluation, BenchmarkVersion]:
    """An evaluation of which the caller may see an aspect, with its benchmark.

    Raises:
        NotFoundError: It does not exist or is not visible to this caller.
        ForbiddenError: It exists, and this aspect of it is withheld from the caller.
    """
    with services.database.reading() as session:
        evaluation = find_visible(session, caller, evaluation_id)
        require(session, caller, evaluation, aspect)
        return evaluation, evaluation.benchmark


def episode_for(
    services: Services, caller: Caller, episode_id: str, aspect: Aspect
) -> tuple[Episode, Evaluation, BenchmarkVersion]:
    """An episode of whose evaluation the caller may see an aspect, with that evaluation and its benchmark.

    Raises:
        NotFoundError: It does not exist or is not visible to this caller.
        ForbiddenError: It exists, and this aspect of it is withheld from the caller.
    """
    with services.database.reading() as session:
        found = reading.find_episode(session, episode_id, seen_by(caller))
        if found is None:
            raise NotFoundError(f"no episode '{episode_id}'")
        episode, evaluation = found
        require(session, caller, evaluation, aspect)
        return episode, evaluation, evaluation.benchmark


def record_path(settings: Settings, episode: Episode) -> Path:
    """Path of an episode's record.

    Raises:
        ConflictError: The episode has no record yet.
        GoneError: The record's file is missing.
    """
    if episode.record_hash is None:
        raise ConflictError(f"episode '{episode.id}' is {episode.status}: it has no record")
    path = archived_path(settings, episode.record_hash)
    if not path.exists():
        raise unreadable(episode)
    return path


def record_of(settings: Settings, episode: Episode) -> EpisodeRecord:
    """An episode's record, after a check of its hash.

    Raises:
        ConflictError: The episode has no record yet.
        GoneError: The record can no longer be read.
    """
    path = record_path(settings, episode)
    _refuse_without_drives(path, episode)
    _refuse_lot(episode)
    return _checked(path, episode, read_record)


def lot_of(settings: Settings, episode: Episode) -> tuple[ParkingRecord, Float32Array]:
    """Record and motion of an episode in a parking lot, after a check of their hashes.

    Raises:
        ConflictError: The episode has no record yet.
        GoneError: The record or the motion can no longer be read.
    """
    path = record_path(settings, episode)
    record = _checked(path, episode, read_lot)
    try:
        return record, read_lot_motion(path, record)
    except InvalidInputError as error:
        raise unreadable(episode, error) from error


def trajectory_of(settings: Settings, episode: Episode) -> Trajectory:
    """An episode's trajectories, after a check of their hash.

    Raises:
        ConflictError: The episode has no record yet.
        GoneError: The record can no longer be read.
    """
    path = record_path(settings, episode)
    _refuse_without_drives(path, episode)
    try:
        return read_trajectory(path)
    except InvalidInputError as error:
        raise unreadable(episode, error) from error


def open_trajectory(settings: Settings, episode: Episode) -> BinaryIO:
    """The file of an episode's trajectories, after a check of their hash; it can be read even if it is deleted.

    Raises:
        ConflictError: The episode has no record yet.
        GoneError: The record can no longer be read.
    """
    path = record_path(settings, episode)
    _refuse_without_drives(path, episode)
    with contextlib.ExitStack() as stack:
        try:
            file = stack.enter_context(path.with_suffix(".parquet").open("rb"))
        except FileNotFoundError as error:
            raise unreadable(episode, error) from error
        lot_of(settings, episode) if is_lot(episode) else trajectory_of(settings, episode)
        stack.pop_all()
    return file


def check_record(settings: Settings, episode: Episode) -> None:
    """Checks the hash of an episode's record, of any kind.

    Raises:
        ConflictError: The episode has no record yet.
        GoneError: The record can no longer be read.
    """
    path = record_path(settings, episode)
    if _is_morning(path, episode):
        _checked(path, episode, MorningRecord.read)
    elif is_day(episode):
        _checked(path, episode, DayRecord.read)
    elif is_lot(episode):
        _checked(path, episode, read_lot)
    else:
        record_of(settings, episode)


def _checked(path: Path, episode: Episode, read: Callable[[Path], R]) -> R:
    """A record of any kind, after a check of its hash."""
    try:
        record = read(path)
    except InvalidInputError as error:
        raise unreadable(episode, error) from error
    if record.record_hash != episode.record_hash:
        raise unreadable(episode)
    return record


def is_lot(episode: Episode) -> bool:
    """Whether an episode is in a parking lot."""
    return episode.cell == LOT


def is_day(episode: Episode) -> bool:
    """Whether an episode is a day of forecasts."""
    return episode.cell == DAY


def _refuse_lot(episode: Episode) -> None:
    if is_lot(episode):
        raise ConflictError(f"episode '{episode.id}' is in a parking lot: it has no drives on roads")


def _is_morning(path: Path, episode: Episode) -> bool:
    """Whether a record is of a freeway morning, which has no trajectories."""
    return episode.cell == MORNING and not path.with_suffix(".parquet").exists()


def _refuse_without_drives(path: Path, episode: Episode) -> None:
    if is_day(episode):
        raise ConflictError(f"episode '{episode.id}' is a day of forecasts: it has a record, but no trajectories")
    if _is_morning(path, episode):
        raise ConflictError(f"episode '{episode.id}' is a freeway morning: it has a record, but no trajectories")


def unreadable(episode: Episode, error: Exception | None = None) -> GoneError:
    """Error for a damaged record; its path appears only in the log."""
    logger.error("record %s of episode %s cannot be read: %s", episode.record_hash, episode.id, error or "missing")
    return GoneError(f"the record of episode '{episode.id}' is missing or damaged on the server")


def refuse_unrepeatable(evaluation: Evaluation) -> None:
    """Refuses to drive again where decisions depended on a remote worker or the clock.

    Raises:
        ConflictError: The episode cannot be driven again here.
    """
    if evaluation.submission.kind is AgentKind.REMOTE:
        raise ConflictError("a remote agent drove this episode: it cannot be driven again here")
    if evaluation.slow_policy != "wait":
        raise ConflictError("this episode was driven in real time: no replay gives the same")
