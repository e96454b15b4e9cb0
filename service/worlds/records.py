"""Records of worlds on the disk: found, and removed."""

from __future__ import annotations

from pathlib import Path

from dohyo.service.errors import ConflictError, GoneError
from dohyo.service.settings import Settings
from dohyo.service.worlds.model import World


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
        raise ConflictError("the world is live, or was not recorded to its end")
    path = record_path(settings, row.id)
    if row.kept_bytes == 0 or not path.exists():
        raise GoneError(f"the record of world '{row.id}' is no longer kept")
    return path


def remove_record(settings: Settings, identifier: str) -> None:
    """Removes the files of a world's record, and those derived from it."""
    for path in records_folder(settings).glob(f"{identifier}.*"):
        path.unlink(missing_ok=True)
