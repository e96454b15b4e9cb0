"""Store: a record on disk is `STEM.json` beside `STEM.parquet`, whole or not at all.

The JSON holds the record's facts and, outside their hash, the digest of the Parquet file's bytes.
"""

from __future__ import annotations

import hashlib
import io
import json
from pathlib import Path
from typing import Any, Final

from pydantic import ValidationError

from dohyo.evaluation.records.foreign_files import check_file_name, read_limited
from dohyo.evaluation.records.other_families import check_has_drives
from dohyo.evaluation.records.record import EpisodeRecord
from dohyo.evaluation.records.trajectory import Trajectory
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.faults import describe_fault
from dohyo.sumo_networks.files import write_atomically
from dohyo.sumo_networks.scenario import content_hash

_PARQUET_DIGEST: Final = "parquet_sha256"
FACTS_LIMIT_BYTES: Final = 50_000_000
TABLE_LIMIT_BYTES: Final = 1_000_000_000
_OUTSIDE_THE_HASH: Final = frozenset({"record_hash", "timing", _PARQUET_DIGEST})


def seal(record: EpisodeRecord) -> EpisodeRecord:
    """The record with its hash: sha256 of its canonical JSON without timing and hash.

    Raises:
        InvalidInputError: If JSON cannot represent it: an object among an agent's settings, or a NaN.
    """
    try:
        digest = _facts_hash(record.model_dump(mode="json"))
    except ValueError as error:
        raise InvalidInputError(f"record of scenario '{record.scenario.name}' is not plain JSON: {error}") from error
    return record.model_copy(update={"record_hash": digest})


def write_record(directory: Path, stem: str, record: EpisodeRecord, trajectory: Trajectory) -> Path:
    """Writes a sealed record, replacing one of the same stem.

    A record exists if its JSON exists. An old JSON is therefore removed first and the new one written last: after any
    interruption there is a whole record or none.

    Args:
        directory: Folder of the record; made if missing.
        stem: Name of both files without their suffix.
        record: Sealed record, see `seal`.
        trajectory: Trajectory of the record, with the digest that it states.

    Returns:
        Path of the JSON file.

    Raises:
        InvalidInputError: If the record is not sealed, the trajectory belongs to another record, or the stem is no file
            name.
        OSError: If the files cannot be written.
    """
    check_file_name(stem, "a record's name")
    if record.record_hash != seal(record).record_hash:
        raise InvalidInputError(f"record '{stem}': expected a sealed record, got hash '{record.record_hash}'")
    if record.trajectory_sha256 != trajectory.sha256():
        raise InvalidInputError(f"record '{stem}': its trajectory_sha256 is not the digest of the trajectory given")
    buffer = io.BytesIO()
    trajectory.write_parquet(buffer)
    document = record.model_dump(mode="json") | {_PARQUET_DIGEST: hashlib.sha256(buffer.getbuffer()).hexdigest()}
    text = json.dumps(document, separators=(",", ":"), allow_nan=False) + "\n"

    directory.mkdir(parents=True, exist_ok=True)
    facts, table = directory / f"{stem}.json", directory / f"{stem}.parquet"
    facts.unlink(missing_ok=True)
    try:
        write_atomically(table, buffer.getvalue())
        write_atomically(facts, text.encode())
    finally:
        if not facts.exists():
            table.unlink(missing_ok=True)
    return facts


def read_record(path: Path) -> EpisodeRecord:
    """Reads the facts of one record and checks their hash; its trajectories may be missing.

    Args:
        path: Path of the JSON file.

    Raises:
        InvalidInputError: If the file is missing, truncated, changed since it was written, or not a record of drives
            on roads.
    """
    return _record(_read_document(path), str(path))


def read_whole_record(path: Path) -> EpisodeRecord:
    """Reads the facts of one record, and checks that the trajectories written with them lie beside it.

    Checking takes 1 ms per MB. `read_trajectory` also unpacks them, and compares them with the record's hash.

    Args:
        path: Path of the JSON file.

    Raises:
        InvalidInputError: As for `read_record`; or the Parquet file is missing, truncated or another one.
    """
    document = _read_document(path)
    _check_table(path, document)
    return _record(document, str(path))


def parse_record(content: bytes, path: str) -> EpisodeRecord:
    """Parses the content of a record's JSON file and checks its hash.

    Args:
        content: Content of the file.
        path: Name of the file in messages.

    Raises:
        InvalidInputError: As for `read_record`.
    """
    return _record(_document(content, path), path)


def read_trajectory(path: Path) -> Trajectory:
    """Reads the trajectories of one record and checks their digest.

    Args:
        path: Path of the record's JSON file.

    Raises:
        InvalidInputError: If either file is missing or damaged, or the trajectories belong to another record.
    """
    document = _read_document(path)
    # Polars may abort the whole process on a damaged file: the digest of the bytes is checked first.
    table = _check_table(path, document)
    trajectory = Trajectory.read_parquet(table)
    if trajectory.sha256() != document.get("trajectory_sha256"):
        raise InvalidInputError(f"{table}: expected the trajectories of {path.name}, got another episode's")
    return trajectory


def read_records(directory: Path) -> list[EpisodeRecord]:
    """Reads all records of a folder in the order of their file names, see `read_record`; temporary files are ignored.

    Args:
        directory: Folder of the records themselves: `records` in a result folder.

    Raises:
        InvalidInputError: If the folder is missing or any of its records cannot be read.
    """
    if not directory.is_dir():
        raise InvalidInputError(f"{directory}: expected a folder of records, and there is none")
    return [read_record(path) for path in sorted(directory.glob("*.json")) if not path.name.startswith(".")]


def _record(document: dict[str, Any], path: str) -> EpisodeRecord:
    """The record of a checked document."""
    try:
        return EpisodeRecord.model_validate({key: value for key, value in document.items() if key != _PARQUET_DIGEST})
    except ValidationError as error:
        told = describe_fault(error, EpisodeRecord)
        raise InvalidInputError(
            f"{path}: expected an episode record as this version of dohyo writes it: {told}"
        ) from error


def _check_table(path: Path, document: dict[str, Any]) -> Path:
    """Path of the Parquet file of a record, after its bytes were compared with the digest in the JSON file."""
    table = path.with_suffix(".parquet")
    digest = hashlib.sha256(read_limited(table, f"the trajectories of {path.name}", TABLE_LIMIT_BYTES)).hexdigest()
    if digest != document.get(_PARQUET_DIGEST):
        raise InvalidInputError(f"{table}: changed since it was written, or truncated: {path.name} has another digest")
    return table


def _read_document(path: Path) -> dict[str, Any]:
    return _document(read_limited(path, "an episode record", FACTS_LIMIT_BYTES), str(path))


def _document(content: bytes, path: str) -> dict[str, Any]:
    """The JSON object of a record of drives, after its facts were compared with the hash in it."""
    try:
        document = json.loads(content)
    except (ValueError, RecursionError) as error:
        raise InvalidInputError(
            f"{path}: expected the JSON of an episode record, truncated or damaged: {error}"
        ) from error
    if not isinstance(document, dict) or "record_hash" not in document:
        raise InvalidInputError(f"{path}: expected an episode record, got JSON without a record_hash")
    check_has_drives(document, path)
    try:
        digest = _facts_hash(document)
    except (ValueError, RecursionError) as error:
        raise InvalidInputError(f"{path}: expected finite numbers and valid text: {error}") from error
    if digest != document["record_hash"]:
        raise InvalidInputError(
            f"{path}: changed since it was written: expected facts with hash "
            f"{document['record_hash']!r:.80}, got {digest}"
        )
    return document


def _facts_hash(document: dict[str, Any]) -> str:
    return content_hash({key: value for key, value in document.items() if key not in _OUTSIDE_THE_HASH})
