"""Records of parking: the facts of one lot, a line of JSON; its hash covers everything in it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Literal

from pydantic import ValidationError

from dohyo.evaluation.parking.benchmark import LotScenario, ParkingBenchmark
from dohyo.evaluation.records.record import AgentInfo
from dohyo.sumo_networks.config import Config
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.faults import describe_fault
from dohyo.sumo_networks.files import write_atomically
from dohyo.sumo_networks.scenario import content_hash

RECORDS = "records.jsonl"
LARGEST_BYTES = 1_000_000_000
Ending = Literal["parked", "collided", "timed_out", "failed"]


class KartRecord(Config):
    """The drive of one kart.

    Attributes:
        ending: How it ended: parked; in contact; out of time; or the agent failed as a program.
        aligned: Whether it parked within 3 degrees and 0.2 m of its spot's axis (ISO 16787).
        time_s: Time until then, s; the kart of an agent that failed brakes from then on.
        inclination_deg: Angle between the axes of kart and spot at the end.
        deviation_m: Distance of the kart's centre to the spot's axis at the end.
        distance_m: Distance of the kart's centre to the spot's centre at the end.
        driven_m: Distance driven.
        shunts: Changes between forwards and backwards.
        touched: What it touched: "wall", "car", "kart", "pedestrian", or "nothing".
        failure: One line for people if the agent failed, else None.
    """

    ending: Ending
    aligned: bool
    time_s: float
    inclination_deg: float
    deviation_m: float
    distance_m: float
    driven_m: float
    shunts: int
    touched: str
    failure: str | None = None

    @property
    def parked(self) -> bool:
        """Whether the kart parked, which is a success."""
        return self.ending == "parked"


class ParkingRecord(Config):
    """The facts of one lot.

    Attributes:
        format: Version of this format.
        benchmark: Whole benchmark, so that the lot can be drawn again.
        seed: Seed of the lot.
        agent: The agent of every kart.
        version: Version of dohyo.
        karts: The drives, in the order of the karts.
        motion_sha256: Hash of the motion of all karts and pedestrians, tick by tick.
        record_hash: Hex sha256 of all the rest.
    """

    format: Literal[1] = 1
    benchmark: ParkingBenchmark
    seed: int
    agent: AgentInfo
    version: str
    karts: tuple[KartRecord, ...]
    motion_sha256: str
    record_hash: str = ""

    @property
    def scenario(self) -> LotScenario:
        """The lot that was driven."""
        return LotScenario(benchmark=self.benchmark, seed=self.seed)

    def sealed(self) -> ParkingRecord:
        """The record with its hash."""
        return self.model_copy(update={"record_hash": self.content_hash()})

    def content_hash(self) -> str:
        """Hash of the facts."""
        return content_hash(self.model_dump(mode="json", exclude={"record_hash"}))


def write_records(folder: Path, records: Sequence[ParkingRecord]) -> Path:
    """Writes the records of an evaluation, complete or not at all.

    Raises:
        InvalidInputError: The file cannot be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        text = "".join(record.model_dump_json() + "\n" for record in records)
        write_atomically(folder / RECORDS, text.encode())
    except OSError as error:
        raise InvalidInputError(f"cannot write '{folder / RECORDS}': {error.strerror}") from error
    return folder / RECORDS


def read_records(path: Path) -> list[ParkingRecord]:
    """Reads the records of an evaluation, all of one agent on one benchmark, each of another lot.

    Raises:
        InvalidInputError: The file is missing or too large, a line is no record, or its hash is another one; or as for
            `check_alike`.
    """
    try:
        if path.stat().st_size > LARGEST_BYTES:
            raise InvalidInputError(f"'{path}': expected records of parking of at most {LARGEST_BYTES} bytes")
        lines = path.read_bytes().splitlines()
    except OSError as error:
        raise InvalidInputError(f"cannot read '{path}': {error.strerror}") from error
    records = [parse_record(line, f"'{path}', line {number}") for number, line in enumerate(lines, 1)]
    check_alike(records, path)
    return records


def check_alike(records: Sequence[ParkingRecord], path: Path) -> None:
    """Checks that records are of one evaluation, and that no lot comes twice.

    A lot that comes twice adds no evidence, and would narrow the intervals.

    Args:
        records: Records of one file or folder.
        path: Its place in messages.

    Raises:
        InvalidInputError: There is none, they are of several agents or benchmarks, or a lot comes twice.
    """
    if not records:
        raise InvalidInputError(f"'{path}': expected records of parking, got none")
    first = records[0]
    if any((one.benchmark.sha256, one.agent) != (first.benchmark.sha256, first.agent) for one in records):
        raise InvalidInputError(f"'{path}': expected records of one agent on one benchmark")
    seed, times = Counter(one.seed for one in records).most_common(1)[0]
    if times > 1:
        raise InvalidInputError(f"'{path}': expected every lot once, got the one with seed {seed} {times} times")


def is_parking_records(path: Path) -> bool:
    """Whether a path is that of records of parking, or of a folder that has them."""
    return path.name == RECORDS or (path / RECORDS).is_file()


def parse_record(content: bytes, where: str) -> ParkingRecord:
    """Parses a record and checks its hash.

    Args:
        content: Its JSON.
        where: Place of the record in messages.

    Raises:
        InvalidInputError: It is no record of a lot, or its hash is another one.
    """
    try:
        record = ParkingRecord.model_validate_json(content)
    except ValidationError as error:
        told = describe_fault(error, ParkingRecord)
        raise InvalidInputError(f"{where}: expected a record of parking: {told}") from error
    if record.record_hash != record.content_hash():
        raise InvalidInputError(f"{where}: the record has been changed: its hash is another one")
    return record
