"""Signing keys of services that this user has met: fetched once, then compared."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from dohyo.evaluation.records.foreign_files import read_limited
from dohyo.evaluation.records.signature import parse_key
from dohyo.service.client.client import Client
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.files import write_atomically
from dohyo.sumo_networks.networks.entries import user_folder

LIMIT_BYTES = 1_000_000


class KnownKeys:
    """Public keys by address of the service, in a JSON file."""

    def __init__(self, path: Path | None = None) -> None:
        """Reads the file; None: `known-signing-keys.json` in the user's folder.

        Raises:
            InvalidInputError: The file is damaged.
        """
        self.path = path or user_folder() / "known-signing-keys.json"
        self._keys = _read(self.path) if self.path.exists() else {}

    def server_of(self, key: str) -> str | None:
        """Address of the service with this key; None for an unknown key."""
        return next((server for server, keys in self._keys.items() if key in keys), None)

    def of_server(self, server: str) -> list[str]:
        """Keys of a service: asked for now, and kept at the first time.

        Raises:
            InvalidInputError: The service signs with a key other than the one that was kept.
            ServiceError: The service cannot be reached.
        """
        with Client(server) as client:
            answer = client.get("/v1/signing-key")
        try:
            current = parse_key(str(answer["key"]))
            keys = [current, *(parse_key(str(key)) for key in answer["retired"])]
        except (KeyError, TypeError) as error:
            raise InvalidInputError(f"{server}: expected its signing keys, got another answer") from error
        kept = self._keys.setdefault(server, keys)
        if current not in kept:
            raise InvalidInputError(
                f"{server} signs with key {current}, and its key was {kept[0]}. If its organiser confirms the new key, "
                f"remove the address from {self.path}"
            )
        self.path.parent.mkdir(parents=True, exist_ok=True)
        write_atomically(self.path, json.dumps(self._keys, indent=1).encode())
        return kept


def _read(path: Path) -> dict[str, list[str]]:
    try:
        document: Any = json.loads(read_limited(path, "known signing keys", LIMIT_BYTES))
        return {str(server): [parse_key(key) for key in keys] for server, keys in document.items()}
    except (ValueError, AttributeError, TypeError, RecursionError) as error:
        raise InvalidInputError(f"{path}: expected lists of keys by address: {error}") from error
