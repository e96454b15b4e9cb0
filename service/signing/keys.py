"""Signing keys of the service: one that signs, and earlier ones whose signatures still count."""

from __future__ import annotations

import os
from functools import cached_property
from pathlib import Path

from cryptography.exceptions import UnsupportedAlgorithm
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from cryptography.hazmat.primitives.serialization import (
    Encoding,
    NoEncryption,
    PrivateFormat,
    load_pem_private_key,
)

from dohyo.evaluation.records.signature import Signature, public_key, sign
from dohyo.sumo_networks.errors import InvalidInputError


class SigningKeys:
    """Keys in the data folder, as PEM (PKCS 8). The file of the current key is made if it is missing."""

    def __init__(self, current: Path, retired: Path) -> None:
        """Reads nothing yet.

        Args:
            current: File of the key that signs.
            retired: Folder of earlier keys.
        """
        self._current, self._retired = current, retired

    def prepare(self) -> None:
        """Makes the key if it is missing, and reads all keys.

        Raises:
            InvalidInputError: A file is no Ed25519 key, or others may read the current one.
        """
        _ = self._private, self.retired

    def sign(self, record_hash: str) -> Signature:
        """Signature of a record by its content hash."""
        return sign(self._private, record_hash)

    @property
    def public(self) -> str:
        """Public part of the key that signs, base64."""
        return public_key(self._private)

    @cached_property
    def retired(self) -> tuple[str, ...]:
        """Public parts of earlier keys, base64, by file name."""
        return tuple(public_key(_read(path)) for path in sorted(self._retired.glob("*.pem")))

    @cached_property
    def _private(self) -> Ed25519PrivateKey:
        if not self._current.exists():
            _write_new(self._current)
        if self._current.stat().st_mode & 0o077:
            raise InvalidInputError(f"{self._current}: expected a file that only its owner may read (chmod 600)")
        return _read(self._current)


def _write_new(path: Path) -> None:
    """Writes a new key that nobody else may read; an existing file is left as it is."""
    content = Ed25519PrivateKey.generate().private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption())
    draft = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    draft.unlink(missing_ok=True)
    with os.fdopen(os.open(draft, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())
    try:
        os.link(draft, path)
    except FileExistsError:
        pass
    finally:
        draft.unlink()


def _read(path: Path) -> Ed25519PrivateKey:
    try:
        key = load_pem_private_key(path.read_bytes(), password=None)
    except (OSError, ValueError, TypeError, UnsupportedAlgorithm) as error:
        raise InvalidInputError(f"{path}: expected an Ed25519 private key in PEM: {error}") from error
    if not isinstance(key, Ed25519PrivateKey):
        raise InvalidInputError(f"{path}: expected an Ed25519 private key, got {type(key).__name__}")
    return key
