"""Records of worlds on the disk: found, and removed."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from dohyo.evaluation.records.record import EpisodeRecord
from dohyo.evaluation.records.store import parse_record, read_whole_record
from dohyo.service.episodes.archive import record_size
from dohyo.service.errors import ConflictError, GoneError
from dohyo.service.settings import Settings
from dohyo.service.worlds.model import World, WorldStatus
from dohyo.sumo_networks.errors import InvalidInputError


def records_folder(settings: Settings) -> Path:
    """Folder of the records of worlds."""
    return settings.data / "worlds"


def record_path(settings: Settings, identifier: str) -> Path:
    """Path of the record of a world; its trajectory lies beside it."""
    return records_folder(settings) / f"{identifier}.json"


def kept_record(settings: Settings, row: World) -> Path:
    """Path of the record that a world has.

    Raises:
        ConflictError: It has none.
        GoneError: It is no longer kept.
    """
    if row.record_hash is None:
        raise ConflictError(_why_none(row))
    path = record_path(settings, row.id)
    if row.kept_bytes == 0 or not path.exists():
        raise GoneError(f"the record of world '{row.id}' is no longer kept")
    return path


def read_kept_record(settings: Settings, row: World) -> bytes:
    """Content of the record that a world has, after a check of its hash.

    Raises:
        ConflictError: It has none.
        GoneError: It is no longer kept, or not whole.
    """
    path = kept_record(settings, row)
    with _gone(row):
        content = path.read_bytes()
        _check_hash(parse_record(content, path.name), row)
    return content


def open_kept_trajectory(settings: Settings, row: World) -> BinaryIO:
    """The file of a world's trajectories, after a check of it; it can be read even if it is deleted.

    Raises:
        ConflictError: The world has no record.
        GoneError: It is no longer kept, or not whole.
    """
    path = kept_record(settings, row)
    with _gone(row), contextlib.ExitStack() as stack:
        file = stack.enter_context(path.with_suffix(".parquet").open("rb"))
        _check_hash(read_whole_record(path), row)
        stack.pop_all()
    return file


@contextlib.contextmanager
def _gone(row: World) -> Iterator[None]:
    try:
        yield
    except (InvalidInputError, OSError) as error:
        raise GoneError(f"the record of world '{row.id}' is no longer kept, or not whole") from error


def _check_hash(record: EpisodeRecord, row: World) -> None:
    if record.record_hash != row.record_hash:
        raise InvalidInputError(f"expected the record {row.record_hash}, got {record.record_hash}")


def _why_none(row: World) -> str:
    if row.status.live:
        return "the world is live: its record is there once it has ended"
    if row.status is WorldStatus.FAILED:
        return f"the world has failed, and has no record: {row.reason}"
    return "the world was made without a record"


def whole_record(settings: Settings, row: World) -> tuple[EpisodeRecord, int] | None:
    """The record of a world whose end was not stored, and its size in bytes; None where it is not whole."""
    path = record_path(settings, row.id)
    try:
        return read_whole_record(path), record_size(path)
    except (InvalidInputError, OSError):
        return None


def remove_record(settings: Settings, identifier: str) -> None:
    """Removes the files of a world's record, and those derived from it."""
    for path in records_folder(settings).glob(f"{identifier}.*"):
        path.unlink(missing_ok=True)
