"""Signature of a record by the service that drove it: Ed25519 (RFC 8032) over the record's content hash.

The signature lies beside the record as `NAME.json.sig` and is no part of it. It proves that the owner of a key vouches
for the facts; `dohyo verify` drives again to prove the facts themselves.
"""

from __future__ import annotations

import base64
import binascii
from pathlib import Path
from typing import Annotated, Final, Literal, Protocol

from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey
from pydantic import Field, ValidationError

from dohyo.evaluation.records.foreign_files import read_limited
from dohyo.sumo_networks.config import Config
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.faults import describe_fault

SUFFIX: Final = ".sig"
LIMIT_BYTES: Final = 4096
_PURPOSE: Final = b"dohyo record\n"
"""Begins every signed message, so that a signature of a record means nothing elsewhere."""

Key = Annotated[str, Field(pattern=r"^[A-Za-z0-9+/]{43}=$")]
"""A public key: its 32 bytes as base64."""


class Sealed(Protocol):
    """A record of any kind."""

    @property
    def record_hash(self) -> str:
        """Hash of its facts, hex sha256."""


class Signature(Config):
    """Content of `NAME.json.sig`.

    Attributes:
        algorithm: Always Ed25519.
        key: Public key of the signer, base64.
        record_hash: Content hash of the record that was signed.
        signature: 64 bytes, base64.
    """

    algorithm: Literal["Ed25519"] = "Ed25519"
    key: Key
    record_hash: Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
    signature: Annotated[str, Field(pattern=r"^[A-Za-z0-9+/]{86}==$")]

    def check(self, record: Sealed) -> None:
        """Checks that the key's owner signed this record.

        Raises:
            InvalidInputError: It is the signature of another record, or was not made with the key.
        """
        if self.record_hash != record.record_hash:
            raise InvalidInputError(
                f"the signature is of another record: expected hash {record.record_hash}, got {self.record_hash}"
            )
        try:
            public = Ed25519PublicKey.from_public_bytes(base64.b64decode(self.key))
            public.verify(base64.b64decode(self.signature), _PURPOSE + self.record_hash.encode())
        except (InvalidSignature, ValueError) as error:
            raise InvalidInputError(f"the signature was not made with key {self.key}") from error


def sign(private: Ed25519PrivateKey, record_hash: str) -> Signature:
    """Signature of a record by its content hash."""
    made = private.sign(_PURPOSE + record_hash.encode())
    return Signature(key=public_key(private), record_hash=record_hash, signature=base64.b64encode(made).decode())


def public_key(private: Ed25519PrivateKey) -> str:
    """Public part of a key, base64."""
    return base64.b64encode(private.public_key().public_bytes_raw()).decode()


def parse_key(text: str) -> str:
    """A public key from text for people.

    Raises:
        InvalidInputError: It is no base64 of 32 bytes.
    """
    try:
        if len(base64.b64decode(text.strip(), validate=True)) == 32:
            return text.strip()
    except binascii.Error:
        pass
    raise InvalidInputError(f"expected a public key, 32 bytes as base64, got {text!r:.80}")


def signature_path(record: Path) -> Path:
    """Path of the signature of a record's JSON file."""
    return record.with_name(record.name + SUFFIX)


def read_signature(record: Path) -> Signature | None:
    """The signature beside a record; None if there is none.

    Raises:
        InvalidInputError: The file cannot be read or is no signature.
    """
    path = signature_path(record)
    if not path.exists():
        return None
    try:
        return Signature.model_validate_json(read_limited(path, "a signature", LIMIT_BYTES))
    except ValidationError as error:
        raise InvalidInputError(f"{path}: expected a signature: {describe_fault(error, Signature)}") from error
