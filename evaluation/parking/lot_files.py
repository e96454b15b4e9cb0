"""Files of single lots, as a service keeps and sends them: `NAME.json` with the record, `NAME.parquet` with the motion.

Records of a local evaluation are the lines of one file, see `dohyo.evaluation.parking.record`.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from pydantic import Field

from dohyo.evaluation.parking.benchmark import LOT, ParkingBenchmark
from dohyo.evaluation.parking.motion import read_motion_file, write_motion_file
from dohyo.evaluation.parking.record import ParkingRecord, check_alike, parse_record
from dohyo.evaluation.records.foreign_files import read_limited
from dohyo.evaluation.running.manifest import MANIFEST, RECORDS, ResultManifest, parse_manifest
from dohyo.sumo_networks.arrays import Float32Array
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.files import write_atomically

if TYPE_CHECKING:
    from dohyo.evaluation.parking.drive import Drive  # loads numba

LARGEST_BYTES = 1_000_000
WHAT = "the record of a parking lot"


def write_lot(directory: Path, stem: str, drive: Drive) -> None:
    """Writes the drive of one lot; the record comes last, so that one without motion never exists."""
    directory.mkdir(parents=True, exist_ok=True)
    write_motion_file(directory / f"{stem}.parquet", [drive])
    write_atomically(directory / f"{stem}.json", drive.record.model_dump_json().encode())


def read_lot(path: Path) -> ParkingRecord:
    """Reads the record of one lot.

    Raises:
        InvalidInputError: The file is missing, or no such record, or its hash is another one.
    """
    return parse_record(read_limited(path, WHAT, LARGEST_BYTES), str(path))


def read_lot_motion(path: Path, record: ParkingRecord) -> Float32Array:
    """Motion of one lot, beside its record; see `Drive`.

    Raises:
        InvalidInputError: The file is missing or damaged, or its motion is not that of the record.
    """
    return read_motion_file(path.with_suffix(".parquet"), [record])[record.seed]


def is_lot(path: Path) -> bool:
    """Whether a file looks like the record of a lot.

    Raises:
        InvalidInputError: The file is missing.
    """
    if not path.is_file() or path.stat().st_size > LARGEST_BYTES:
        return False
    try:
        document = json.loads(read_limited(path, WHAT, LARGEST_BYTES))
    except (ValueError, RecursionError):
        return False
    return isinstance(document, dict) and "karts" in document and "motion_sha256" in document


def is_lots_folder(folder: Path) -> bool:
    """Whether a folder holds fetched lots, by its manifest."""
    try:
        document = json.loads(read_limited(folder / MANIFEST, "a manifest", LARGEST_BYTES))
        return bool(document["benchmark"]["kind"] == "parking")
    except (InvalidInputError, ValueError, LookupError, TypeError, RecursionError):
        return False  # the function that reads it as a manifest of drives reports the error


def read_lots(folder: Path) -> list[ParkingRecord]:
    """Reads the records of fetched lots, by seed.

    Raises:
        InvalidInputError: One is damaged, or as for `check_alike`.
    """
    records = [read_lot(path) for path in (folder / RECORDS).glob("*.json")]
    check_alike(records, folder)
    return sorted(records, key=lambda record: record.seed)


def read_lot_motions(folder: Path, records: Sequence[ParkingRecord]) -> dict[int, Float32Array]:
    """Motion of some fetched lots by seed.

    Raises:
        InvalidInputError: A file is missing or damaged.
    """
    return {one.seed: read_lot_motion(folder / RECORDS / f"{LOT}-s{one.seed}.json", one) for one in records}


class LotsManifest(ResultManifest):
    """Description of a result folder of lots.

    Attributes:
        seeds: Seeds of the lots that were ordered; None: unknown, in folders of before.
    """

    benchmark: ParkingBenchmark
    seeds: Annotated[tuple[int, ...] | None, Field(exclude_if=lambda seeds: seeds is None)] = None


def part_of_lots(folder: Path, records: Sequence[ParkingRecord]) -> str:
    """What is there of the lots that were ordered, in words for people; "" if all are, or nobody knows.

    Args:
        folder: Folder of fetched lots.
        records: Records in it.

    Raises:
        InvalidInputError: Its manifest is none.
    """
    content = read_limited(folder / MANIFEST, "a manifest", LARGEST_BYTES)
    manifest = parse_manifest(content, str(folder / MANIFEST), LotsManifest)
    done, ordered = len(records), len({*(manifest.seeds or ()), *(record.seed for record in records)})
    return f"part of {manifest.benchmark.name}: {done} of {ordered} lots" if done < ordered else ""
