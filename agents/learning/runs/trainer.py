"""Trainer: what `dohyo train` calls, and what it asks for."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Generic, TypeVar

from dohyo.agents.learning.files.report import Reporter
from dohyo.sumo_networks.config import Config

C = TypeVar("C", bound=Config)


@dataclass(frozen=True, slots=True)
class TrainRequest:
    """Request for a training.

    Attributes:
        name: Of the trainer.
        out: Folder of the run.
        resume: Continue the existing run.
        report: Called with the progress.
    """

    name: str
    out: Path
    resume: bool
    report: Reporter


@dataclass(frozen=True, slots=True)
class Trainer(Generic[C]):
    """Trainer of one system.

    Attributes:
        summary: Subject, in a few words.
        config: Its settings.
        train: Trains, and returns the resulting file.
    """

    summary: str
    config: type[C]
    train: Callable[[C, TrainRequest], Path]
