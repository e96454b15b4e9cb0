"""Metrics: rows can be read back."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from dohyo.agents.learning.files.metrics import Number, Table


def test_numbers_of_numpy_can_be_read_back(tmp_path: Path) -> None:
    row: dict[str, Number] = {"a": np.float64(0.1), "b": np.float32(0.1), "c": np.int64(3), "d": 0.1, "e": None}  # type: ignore[dict-item]
    table = Table(tmp_path / "metrics.csv", tuple(row), None)
    table.add(7, row)
    table.close()
    with (tmp_path / "metrics.csv").open() as file:
        (read,) = csv.DictReader(file)
    assert read == {"steps": "7", "a": "0.1", "b": repr(float(np.float32(0.1))), "c": "3", "d": "0.1", "e": ""}
