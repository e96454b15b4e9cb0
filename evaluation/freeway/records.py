"""Records on the freeway: one JSON file each, whose hash covers everything in it except the wall-clock time."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar, Literal, Self

from pydantic import ValidationError

from dohyo.evaluation.records.foreign_files import read_limited
from dohyo.evaluation.records.record import AgentInfo
from dohyo.evaluation.records.store import FACTS_LIMIT_BYTES
from dohyo.sumo_networks.config import Config
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.faults import describe_fault
from dohyo.sumo_networks.files import write_atomically
from dohyo.sumo_networks.scenario import content_hash

LARGEST_BYTES = 1_000_000


class FreewayRecord(Config):
    """Base of the records of mornings and of days.

    Attributes:
        format: Version of this format.
        benchmark: Name and content hash.
        agent: What planned or forecast.
        failure: Fault of the agent that ended the episode; None: the episode is complete.
        wall_s: Wall-clock time, s; in no hash.
        record_hash: Hex sha256 of all the rest.
    """

    what: ClassVar[str]
    """Words for such a record in messages."""

    format: Literal[1] = 1
    benchmark: tuple[str, str]
    agent: AgentInfo
    failure: str | None = None
    wall_s: float = 0.0
    record_hash: str = ""

    @classmethod
    def read(cls, path: Path) -> Self:
        """Reads a record.

        Raises:
            InvalidInputError: The file is missing, or no such record, or its hash is another one.
        """
        return cls.parse(read_limited(path, cls.what, LARGEST_BYTES), str(path))

    @classmethod
    def parse(cls, content: bytes, path: str) -> Self:
        """Parses the content of a record's file and checks its hash.

        Args:
            content: Content of the file.
            path: Name of the file in messages.

        Raises:
            InvalidInputError: It is no such record, or its hash is another one.
        """
        try:
            record = cls.model_validate_json(content)
        except ValidationError as error:
            raise InvalidInputError(f"{path}: expected {cls.what}: {describe_fault(error, cls)}") from error
        if record.record_hash != record.content_hash():
            raise InvalidInputError(f"{path}: the record has been changed: its hash is another one")
        return record

    def write(self, directory: Path, stem: str) -> None:
        """Writes the record with its hash, complete or not at all."""
        directory.mkdir(parents=True, exist_ok=True)
        write_atomically(directory / f"{stem}.json", self.sealed().model_dump_json(indent=1).encode())

    def sealed(self) -> Self:
        """The record with its hash."""
        return self.model_copy(update={"record_hash": self.content_hash()})

    def content_hash(self) -> str:
        """Hash of the facts."""
        facts: dict[str, Any] = self.model_dump(mode="json", exclude={"record_hash", "wall_s"})
        return content_hash(facts)


def facts_at(path: Path) -> Mapping[str, Any]:
    """The JSON object of a record's file of any kind, unchecked; empty where it is none.

    Raises:
        InvalidInputError: The file is missing or too large.
    """
    try:
        document = json.loads(read_limited(path, "a record", FACTS_LIMIT_BYTES))
    except (ValueError, RecursionError):
        return {}
    return document if isinstance(document, dict) else {}
