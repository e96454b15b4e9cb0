"""Downloads of records: what a server sends is checked before it becomes a file, and never chooses its path."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Final

from pydantic import ValidationError

from dohyo.evaluation.freeway.day import DAY, DayRecord
from dohyo.evaluation.freeway.morning import MORNING, MorningRecord
from dohyo.evaluation.parking.benchmark import LOT
from dohyo.evaluation.parking.record import ParkingRecord
from dohyo.evaluation.parking.record import parse_record as parse_lot
from dohyo.evaluation.records.foreign_files import check_file_name
from dohyo.evaluation.records.record import EpisodeRecord
from dohyo.evaluation.records.signature import Signature, signature_path
from dohyo.evaluation.records.store import FACTS_LIMIT_BYTES, TABLE_LIMIT_BYTES, parse_record
from dohyo.service.client.calls import Call, path_of
from dohyo.sumo_networks.errors import InvalidInputError

if TYPE_CHECKING:
    from dohyo.service.client.answers import EpisodeView

_Parser = Callable[[bytes, str], EpisodeRecord | MorningRecord | ParkingRecord | DayRecord]
_PARSERS: Final[Mapping[str, _Parser]] = {MORNING: MorningRecord.parse, LOT: parse_lot, DAY: DayRecord.parse}

SIGNATURE_HEADER: Final = "dohyo-signature"


class Download:
    """Files of one episode's record.

    Attributes:
        path: Path of the record's JSON file.
        parts: Path, request and largest size of each file; the facts come last, as in `write_record`. Mornings and
            days of forecasts have no trajectories.
    """

    def __init__(self, episode: EpisodeView, folder: Path) -> None:
        """Reads an episode as the server lists it.

        Raises:
            InvalidInputError: Its names cannot be a file name.
        """
        stem = check_file_name(f"{episode['scenario']}-s{episode['seed']}", "the server's name of an episode")
        self._episode, cell = episode, str(episode.get("cell"))
        self._parse = _PARSERS.get(cell, parse_record)
        self.path = folder / f"{stem}.json"
        record, trajectory = (
            Call("GET", path_of("episodes", str(episode["id"]), part)) for part in ("record", "trajectory")
        )
        facts = (self.path, record, FACTS_LIMIT_BYTES)
        table = (self.path.with_suffix(".parquet"), trajectory, TABLE_LIMIT_BYTES)
        self.parts = (facts,) if cell in (MORNING, DAY) else (table, facts)

    def files(self, path: Path, content: bytes, headers: Mapping[str, str]) -> list[tuple[Path, bytes]]:
        """Files to write for one answer: itself, and the signature of the facts before them.

        Raises:
            InvalidInputError: The facts are not those of the episode, or their signature is wrong.
        """
        if path != self.path:
            return [(path, content)]
        record, episode = self._parse(content, path.name), self._episode
        there = (record.scenario.name, record.scenario.seed, record.record_hash)
        if there != (episode["scenario"], episode["seed"], episode["record_hash"]):
            raise InvalidInputError(f"{path.name}: expected the record of this episode, got another episode's")
        signed = signature_of(headers, record.record_hash)
        if signed is None:
            return [(path, content)]
        signed.check(record)
        return [(signature_path(path), signed.model_dump_json().encode()), (path, content)]


def signature_header(signature: Signature) -> str:
    """Value of the header `dohyo-signature`: algorithm, public key, signature."""
    return f"{signature.algorithm} {signature.key} {signature.signature}"


def signature_of(headers: Mapping[str, str], record_hash: str) -> Signature | None:
    """Signature in the headers of a record; None if the server does not sign.

    Raises:
        InvalidInputError: The header has another form.
    """
    value = headers.get(SIGNATURE_HEADER)
    if value is None:
        return None
    try:
        algorithm, key, signature = value.split(" ")
        return Signature.model_validate(
            {"algorithm": algorithm, "key": key, "signature": signature, "record_hash": record_hash}
        )
    except (ValueError, ValidationError) as error:
        raise InvalidInputError(f"expected '{SIGNATURE_HEADER}: Ed25519 KEY SIGNATURE', got {value!r:.80}") from error


def check_size(content: bytes | bytearray, limit_bytes: int, call: Call) -> None:
    """Checks that an answer is not longer than a limit.

    Raises:
        InvalidInputError: It is longer.
    """
    if len(content) > limit_bytes:
        raise InvalidInputError(
            f"{call.path}: expected at most {limit_bytes // 1_000_000} MB, and the server sent more"
        )
