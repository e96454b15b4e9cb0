"""Drives on disk: arrays of one ego per folder, memory-mapped, as data of encoders and of imitation.

    FOLDER/dataset.json                     what was ordered
    FOLDER/SPLIT/SCENARIO/EGO/NAME.npy      (T, ...) one array per sensor, and the actions
    FOLDER/SPLIT/SCENARIO/EGO/drive.json    agent, network, seed, rows, and the arrays' digest

A scenario's folder appears when it is complete, so that nothing there is half-written.
"""

from __future__ import annotations

import hashlib
import io
import json
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dohyo.sumo_networks.arrays import IntArray
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.files import write_atomically

Arrays = Mapping[str, NDArray[Any]]
FACTS = "drive.json"


def write_drives(folder: Path, drives: Mapping[str, tuple[Arrays, Mapping[str, Any]]]) -> None:
    """Writes the drives of one scenario: all of them, or nothing.

    Args:
        folder: Of the scenario; does not exist yet.
        drives: Arrays, each of T rows, and facts, by ego.

    Raises:
        InvalidInputError: The arrays of a drive differ in their numbers of rows.
        OSError: The files cannot be written.
    """
    draft = folder.with_name(f".{folder.name}.tmp")
    shutil.rmtree(draft, ignore_errors=True)
    for ego, (arrays, facts) in drives.items():
        if len({len(array) for array in arrays.values()}) != 1:
            raise InvalidInputError(f"drive '{ego}': expected arrays of as many rows, got {_rows(arrays)}")
        (draft / ego).mkdir(parents=True)
        for name, array in arrays.items():
            write_atomically(draft / ego / f"{name}.npy", _npy(array))
        rows = len(next(iter(arrays.values())))
        document = {**facts, "ego": ego, "rows": rows, "sha256": digest_of(arrays)}
        write_atomically(draft / ego / FACTS, (json.dumps(document, indent=1) + "\n").encode())
    draft.rename(folder)


def digest_of(arrays: Arrays) -> str:
    """SHA-256 of names, types, shapes and values."""
    digest = hashlib.sha256()
    for name in sorted(arrays):
        array = np.ascontiguousarray(arrays[name])
        digest.update(f"{name} {array.dtype.str} {array.shape}".encode())
        digest.update(array.data)
    return digest.hexdigest()


@dataclass(frozen=True, slots=True)
class Drive:
    """One ego's drive.

    Attributes:
        facts: Of `drive.json`: agent, network, scenario, seed, ego, rows, sha256.
        arrays: (T, ...) memory-mapped, by name.
    """

    facts: dict[str, Any]
    arrays: dict[str, NDArray[Any]]

    def __len__(self) -> int:
        return int(self.facts["rows"])

    @classmethod
    def load(cls, folder: Path) -> Drive:
        """Maps the arrays of a folder; reads none of their values.

        Raises:
            InvalidInputError: A file is missing or damaged.
        """
        try:
            facts = json.loads((folder / FACTS).read_text())
            arrays = {path.stem: np.load(path, mmap_mode="r") for path in sorted(folder.glob("*.npy"))}
            rows = int(facts["rows"])
        except (OSError, ValueError, EOFError, KeyError, TypeError) as error:
            raise InvalidInputError(f"drive '{folder}' is damaged: {error}; record it again") from error
        if any(len(array) != rows for array in arrays.values()):
            raise InvalidInputError(f"drive '{folder}': expected {rows} rows, got {_rows(arrays)}")
        return cls(facts, arrays)


class Drives:
    """All drives of one split, whose rows are numbered from the first drive's first to the last one's last.

    Attributes:
        drives: In the order of their folders' names.
        starts: (D + 1,) number of the first row of each drive, and of all rows.
    """

    def __init__(self, folder: Path, split: str) -> None:
        """Maps the files.

        Raises:
            InvalidInputError: There are no drives, one is damaged, or they hold different arrays.
        """
        paths = sorted((folder / split).glob(f"[!.]*/*/{FACTS}"))
        if not paths:
            raise InvalidInputError(f"expected drives in '{folder / split}', found none")
        self.drives = [Drive.load(path.parent) for path in paths]
        for path, drive in zip(paths, self.drives, strict=True):
            if _forms(drive) != _forms(self.drives[0]):
                raise InvalidInputError(
                    f"drive '{path.parent}': expected arrays {_forms(self.drives[0])}, got {_forms(drive)}"
                )
        self.starts: IntArray = np.cumsum([0, *(len(drive) for drive in self.drives)])

    def __len__(self) -> int:
        return int(self.starts[-1])

    @cached_property
    def digest(self) -> str:
        """SHA-256 of the drives' digests, in their order."""
        return hashlib.sha256("".join(drive.facts["sha256"] for drive in self.drives).encode()).hexdigest()

    def rows(self, index: IntArray) -> dict[str, NDArray[Any]]:
        """(N, ...) arrays of some rows, by name, in memory."""
        return {name: self.column(name)[index] for name in self.drives[0].arrays}

    def column(self, name: str) -> Column:
        """One array over all drives.

        Raises:
            InvalidInputError: The drives hold no such array.
        """
        if name not in self.drives[0].arrays:
            raise InvalidInputError(f"expected one of {', '.join(self.drives[0].arrays)}, got '{name}'")
        return Column([drive.arrays[name] for drive in self.drives], self.starts, f"{name} of {self.digest}")

    def check(self) -> None:
        """Reads all values, and compares them with the digests.

        Raises:
            InvalidInputError: A drive has changed since it was recorded.
        """
        for drive in self.drives:
            if (found := digest_of(drive.arrays)) != drive.facts["sha256"]:
                raise InvalidInputError(
                    f"drive of '{drive.facts['ego']}' in '{drive.facts['scenario']}': "
                    f"expected arrays of sha256 {drive.facts['sha256']}, got {found}"
                )


@dataclass(frozen=True, slots=True)
class Column:
    """One array over several drives, as if they were one.

    Attributes:
        parts: (T, ...) of each drive.
        starts: (D + 1,) number of the first row of each drive, and of all rows.
        digest: Names the values.
    """

    parts: list[NDArray[Any]]
    starts: IntArray
    digest: str

    @classmethod
    def of(cls, array: NDArray[Any]) -> Column:
        """An array in memory."""
        return cls([array], np.array([0, len(array)]), digest_of({"": array}))

    def __len__(self) -> int:
        return int(self.starts[-1])

    def __getitem__(self, rows: slice | IntArray) -> NDArray[Any]:
        """(N, ...) some rows, in memory."""
        index = np.arange(len(self))[rows]
        out = np.empty((len(index), *self.parts[0].shape[1:]), self.parts[0].dtype)
        places = np.searchsorted(self.starts, index, side="right") - 1
        for place in np.unique(places):
            chosen = places == place
            out[chosen] = self.parts[place][index[chosen] - self.starts[place]]
        return out


def _rows(arrays: Arrays) -> str:
    return ", ".join(f"{name} {len(array)}" for name, array in arrays.items())


def _forms(drive: Drive) -> dict[str, tuple[str, tuple[int, ...]]]:
    return {name: (array.dtype.name, array.shape[1:]) for name, array in drive.arrays.items()}


def _npy(array: NDArray[Any]) -> bytes:
    buffer = io.BytesIO()
    np.save(buffer, array, allow_pickle=False)
    return buffer.getvalue()
