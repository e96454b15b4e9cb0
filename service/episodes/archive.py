"""Archive: moves a finished record from staging to a path by its hash, complete or not at all.

A record is first linked into the archive, then stored in the database, then linked again if the deletion of an equal
record has removed it meanwhile, then removed from staging. After an interruption the steps can be repeated.
"""

from __future__ import annotations

import os
import shutil
from pathlib import Path

from dohyo.evaluation.freeway.day import DayRecord, DayScenario
from dohyo.evaluation.freeway.morning import MorningRecord, MorningScenario
from dohyo.evaluation.freeway.records import FreewayRecord
from dohyo.evaluation.parking.benchmark import LotScenario
from dohyo.evaluation.parking.lot_files import read_lot, read_lot_motion
from dohyo.evaluation.parking.record import ParkingRecord
from dohyo.evaluation.records.record import EpisodeRecord
from dohyo.evaluation.records.store import read_record
from dohyo.service.benchmarks.catalog import AnyScenario
from dohyo.service.running.faults import SUFFIX as FAULT
from dohyo.service.settings import Settings
from dohyo.service.storage.files import file_lock
from dohyo.sumo_networks.errors import InvalidInputError

Record = EpisodeRecord | MorningRecord | ParkingRecord | DayRecord


def staged_folder(settings: Settings, evaluation_id: str) -> Path:
    """Folder into which the processes write the records of an evaluation."""
    return settings.staging / evaluation_id


def archived_path(settings: Settings, record_hash: str) -> Path:
    """Path of a record's JSON file; the Parquet file lies beside it."""
    return settings.records / record_hash[:2] / f"{record_hash}.json"


def record_size(facts: Path) -> int:
    """Size of a record's files, bytes."""
    return sum(file.stat().st_size for file in (facts, facts.with_suffix(".parquet")) if file.exists())


def shelve(settings: Settings, staged: Path, scenario: AnyScenario) -> Record:
    """Links a staged record into the archive, unless the same hash is there already.

    A record that `lost_because` gives a reason for is returned but not archived.

    Args:
        settings: Settings with the archive's folder.
        staged: Path of the record's JSON file.
        scenario: Scenario that the record must be of.

    Raises:
        InvalidInputError: The record is missing, incomplete, or of another scenario.
        OSError: A file operation failed.
    """
    record = _read(staged, scenario)
    if record.scenario != scenario:
        raise InvalidInputError(f"{staged}: expected a record of scenario '{scenario.name}', seed {scenario.seed}")
    if lost_because(record) is None:
        ensure_archived(settings, staged, record)
    return record


def _read(staged: Path, scenario: AnyScenario) -> Record:
    match scenario:
        case MorningScenario():
            return MorningRecord.read(staged)
        case DayScenario():
            return DayRecord.read(staged)
        case LotScenario():
            lot = read_lot(staged)
            read_lot_motion(staged, lot)  # must be there and whole
            return lot
        case _:
            return read_record(staged)


def ensure_archived(settings: Settings, staged: Path, record: Record) -> None:
    """Links a staged record into the archive, unless it is there.

    Raises:
        OSError: A file operation failed.
    """
    facts = archived_path(settings, record.record_hash)
    with file_lock(record.record_hash):
        if facts.exists():
            return
        facts.parent.mkdir(parents=True, exist_ok=True)
        # A record exists once its JSON file does, so that file comes last.
        if not isinstance(record, FreewayRecord):
            _link(staged.with_suffix(".parquet"), facts.with_suffix(".parquet"))
        _link(staged, facts)


def lost_because(record: Record) -> str | None:
    """Why an episode is to be driven again; None for a record that is kept, also of a gridlock."""
    if not isinstance(record, EpisodeRecord):
        return None
    return next((ego.failure or ego.status.value for ego in record.egos if ego.status.worth_another_try), None)


def discard(settings: Settings, evaluation_id: str, stem: str | None = None) -> None:
    """Removes one staged record, or all records of an evaluation."""
    folder = staged_folder(settings, evaluation_id)
    if stem is None:
        shutil.rmtree(folder, ignore_errors=True)
        return
    for suffix in (".json", ".parquet", FAULT):
        (folder / f"{stem}{suffix}").unlink(missing_ok=True)


def _link(source: Path, target: Path) -> None:
    """Links a file to a second name and replaces an existing file there."""
    staged = target.with_name(f".{target.name}.{os.getpid()}.tmp")
    staged.unlink(missing_ok=True)
    os.link(source, staged)
    os.replace(staged, target)
