"""Trained arms: a job of a study begins, resumes or only reads RUNS/ARM/seed-N, as `dohyo train` makes it."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from dohyo.agents.learning.runs.memory import keep_freed_memory
from dohyo.agents.studies.arms import Cell
from dohyo.agents.studies.rows import Row
from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.config import Config
from dohyo.sumo_networks.errors import SimulationError

Columns = Mapping[str, FloatArray]


class TrainedOptions(Config):
    """Options of a run on trainings.

    Attributes:
        runs: Folder of all trainings.
        train: Whether trainings begin or resume; False: they are judged as they are.
    """

    runs: Path = Path("out")
    train: bool = True

    def trained(self, name: str, train: Callable[[Path], object], policy: str = "best.onnx") -> Path:
        """Policy of a training.

        Args:
            name: Folder of the training in `runs`, such as "ARM/seed-0".
            train: Trains in that folder, unless this is done.
            policy: Name of the file.

        Raises:
            RunStoppedError: The training was stopped.
            SimulationError: There is no policy so far.
        """
        folder = self.runs / name
        if self.train:
            keep_freed_memory()
            train(folder)
        if not (folder / policy).exists():
            raise SimulationError(f"no policy in '{folder}' so far")
        return folder / policy


def own_trainings(cell: Cell) -> tuple[str, ...]:
    """Training of a cell, ARM/seed-N, for a study whose arms have trainings of their own; empty without one."""
    return () if cell.training_seed is None else (f"{cell.arm}/seed-{cell.training_seed}",)


def result_of(folder: Path, *names: str) -> Row:
    """Some facts of a training so far."""
    told = json.loads((folder / "result.json").read_text())
    return {name: told[name] for name in names}


def columns(path: Path) -> Columns:
    """(R,) values by column of evaluations.csv or metrics.csv; NaN for empty cells."""
    with path.open(newline="") as file:
        header, *rows = list(csv.reader(file)) or [[]]
    values = np.array([[float(cell) if cell else math.nan for cell in row] for row in rows])
    return dict(zip(header, values.reshape(len(rows), len(header)).T, strict=True))
