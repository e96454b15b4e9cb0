"""Signatures of records on the command line: whose key it is, and what is refused."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from dohyo.evaluation.records.foreign_files import read_limited
from dohyo.evaluation.records.signature import LIMIT_BYTES, Sealed, Signature, parse_key, read_signature
from dohyo.service.client.known_keys import KnownKeys
from dohyo.sumo_networks.errors import InvalidInputError

Key = Annotated[
    str | None, typer.Option(help="Public key, or a file with it, that must have signed the record.", metavar="KEY")
]
SignedBy = Annotated[
    str | None, typer.Option("--server", help="Service that must have signed the record; its key is kept.")
]
SignatureOnly = Annotated[
    bool, typer.Option("--signature-only", help="Check hash and signature, and do not drive again.")
]


@dataclass(frozen=True, slots=True)
class Signer:
    """Whose signature a record has.

    Attributes:
        key: Public key; None without a signature.
        owner: Owner of the key; None if it is not known here.
    """

    key: str | None = None
    owner: str | None = None

    @property
    def document(self) -> dict[str, str | None] | None:
        """Plain JSON; None without a signature."""
        return None if self.key is None else {"key": self.key, "owner": self.owner}

    def __str__(self) -> str:
        if self.key is None:
            return "none"
        return f"by {self.key}, " + (self.owner or "a key that is not known here (--server, --key)")


def check_signature(path: Path, record: Sealed, key: str | None, server: str | None) -> Signer:
    """Checks the signature beside a record.

    Args:
        path: Path of the record's JSON file.
        record: The record.
        key: Public key, or a file with it, that must have signed; None: any.
        server: Service that must have signed; None: any.

    Raises:
        InvalidInputError: The signature is not of this record, was not made with its key, or is not by the one that
            must have signed.
        ServiceError: The service cannot be reached.
    """
    try:
        signature = read_signature(path)
        if signature is not None:
            signature.check(record)
    except InvalidInputError as error:
        raise InvalidInputError(f"'{path}': {error}") from error
    known = KnownKeys()
    if key is not None:
        return _by(path, signature, [_key_of(key)], "as given by --key")
    if server is not None:
        return _by(path, signature, known.of_server(server), f"key of {server}")
    if signature is None:
        return Signer()
    owner = known.server_of(signature.key)
    return Signer(signature.key, None if owner is None else f"key of {owner}")


def _by(path: Path, signature: Signature | None, keys: list[str], owner: str) -> Signer:
    if signature is None:
        raise InvalidInputError(f"'{path}': expected a signature by {keys[0]}, and there is none ({path.name}.sig)")
    if signature.key not in keys:
        raise InvalidInputError(f"'{path}': expected a signature by {' or '.join(keys)}, got one by {signature.key}")
    return Signer(signature.key, owner)


def _key_of(text: str) -> str:
    try:
        return parse_key(text)
    except InvalidInputError:
        return parse_key(read_limited(Path(text), "a public key", LIMIT_BYTES).decode("ascii", "replace"))
