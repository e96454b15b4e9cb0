"""Output files: what a user names for a page, a table or a picture, written complete or refused in one line."""

from __future__ import annotations

from pathlib import Path

from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.files import write_atomically


def check_output(path: Path) -> None:
    """Checks, before work of minutes, that an output can be a file.

    Raises:
        InvalidInputError: The path is a folder.
    """
    try:
        is_folder = path.is_dir()
    except OSError as error:
        raise unwritable(path, error) from error
    if is_folder:
        raise InvalidInputError(f"cannot write '{path}': expected a file, got a folder")


def write_output(path: Path, content: bytes) -> None:
    """Writes an output file, complete or not at all, and makes the folder that it is to lie in.

    Raises:
        InvalidInputError: The path is a folder, or cannot be written.
    """
    check_output(path)
    try:
        if not path.parent.exists():
            path.parent.mkdir(parents=True, exist_ok=True)
        write_atomically(path, content)
    except OSError as error:
        raise unwritable(path, error) from error


def unwritable(path: Path, error: OSError) -> InvalidInputError:
    """Error about a file that cannot be written."""
    return InvalidInputError(f"cannot write '{path}': {error.strerror}")
