"""Files of strangers: names that stay in their folder, and contents that end."""

from __future__ import annotations

import re
import stat
from pathlib import Path
from typing import Final

from dohyo.sumo_networks.errors import InvalidInputError

_FILE_NAME: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,199}")
_DEVICE: Final = re.compile(r"(con|prn|aux|nul|com\d|lpt\d)(\..*)?", re.IGNORECASE)


def check_file_name(name: str, what: str) -> str:
    """Checks that a name from elsewhere can name a file on any system, and nothing outside of its folder.

    Args:
        name: Name to check.
        what: Words for it in the message.

    Raises:
        InvalidInputError: It has a character other than letters, digits, `_`, `.` and `-`, is too long, or names a
            device.
    """
    if not _FILE_NAME.fullmatch(name) or name.endswith(".") or _DEVICE.fullmatch(name):
        raise InvalidInputError(
            f"expected {what} to be a file name of up to 200 letters, digits, '_', '.' and '-', got {name!r:.80}"
        )
    return name


def read_limited(path: Path, what: str, limit_bytes: int) -> bytes:
    """Content of a regular file that is not larger than a limit.

    Args:
        path: Path of the file.
        what: Words for the content in messages.
        limit_bytes: Largest size.

    Raises:
        InvalidInputError: The file is missing, larger, cannot be read, or is a device or a pipe.
    """
    try:
        if not stat.S_ISREG(path.stat().st_mode):  # a pipe would block, and a device has no end
            raise InvalidInputError(f"{path}: expected {what}, and it cannot be read: it is no regular file")
        with path.open("rb") as file:
            content = file.read(limit_bytes + 1)
    except FileNotFoundError as error:
        raise InvalidInputError(f"{path}: expected {what}, and there is no such file") from error
    except OSError as error:
        raise InvalidInputError(f"{path}: expected {what}, and it cannot be read: {error.strerror}") from error
    if len(content) > limit_bytes:
        raise InvalidInputError(f"{path}: expected {what} of at most {limit_bytes // 1_000_000} MB, and it is larger")
    return content
