"""Metrics: rows in a CSV file and events for TensorBoard, which continue at a checkpoint."""

from __future__ import annotations

import csv
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.files import write_atomically

Number = int | float | None


class Table:
    """A CSV file whose first column, "steps", grows. Floats are written so that they can be read back exactly."""

    def __init__(self, path: Path, columns: Sequence[str], keep: int | None) -> None:
        """Opens it.

        Args:
            path: Where.
            columns: Beside "steps".
            keep: Rows up to these steps stay, later ones are dropped and come again. None: no row stays.
        """
        self._path, self.columns = path, ("steps", *columns)
        rows = self._kept(keep) if keep is not None and path.exists() else []
        lines = [",".join(self.columns), *(",".join(row) for row in rows)]
        write_atomically(path, ("\n".join(lines) + "\n").encode())
        self._file = path.open("a", newline="")
        self._writer = csv.writer(self._file, lineterminator="\n")

    def add(self, steps: int, values: Mapping[str, Number]) -> None:
        """Writes one row; missing values stay empty."""
        if unknown := values.keys() - set(self.columns):
            raise KeyError(f"{self._path.name} has no column {', '.join(sorted(unknown))}")
        self._writer.writerow([str(steps), *(_shown(values.get(name)) for name in self.columns[1:])])
        self._file.flush()

    def sync(self) -> None:
        """Writes the rows so far to the disk."""
        os.fsync(self._file.fileno())

    def close(self) -> None:
        """Closes it."""
        self._file.close()

    def _kept(self, keep: int) -> list[list[str]]:
        """Complete rows up to `keep` steps; a torn last row is dropped."""
        text = self._path.read_text()
        header, *rows = csv.reader(text[: text.rfind("\n") + 1].splitlines()) or [[]]
        if tuple(header) != self.columns:
            raise InvalidInputError(
                f"'{self._path}': expected columns {', '.join(self.columns)}, got {', '.join(header)}"
            )
        return [row for row in rows if int(row[0]) <= keep]


def _shown(value: Number) -> str:
    """Text of a number; that of NumPy's own would be such as "np.float64(1.0)"."""
    return "" if value is None else repr(value.item() if isinstance(value, np.generic) else value)


class Board:
    """TensorBoard's events; does nothing if they are switched off."""

    def __init__(self, folder: Path | None, steps: int) -> None:
        """Opens a file of events.

        Args:
            folder: Where; None: no events.
            steps: Later events belong to an interrupted run, and are hidden.
        """
        self._writer: Any = None
        if folder is not None:
            from torch.utils.tensorboard import SummaryWriter

            self._writer = SummaryWriter(str(folder), purge_step=steps + 1)

    def add(self, group: str, steps: int, values: Mapping[str, Number]) -> None:
        """Adds one event per value."""
        if self._writer is not None:
            for name, value in values.items():
                if value is not None:
                    self._writer.add_scalar(f"{group}/{name}", value, steps)

    def close(self) -> None:
        """Closes it."""
        if self._writer is not None:
            self._writer.close()
