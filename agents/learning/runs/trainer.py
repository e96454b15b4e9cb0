"""Trainer: what `dohyo train` calls, and what it asks for."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, TypeVar

from dohyo.agents.learning.files.report import Reporter, no_report
from dohyo.agents.learning.files.settings import differences, read_settings
from dohyo.agents.learning.runs.config import RunConfig
from dohyo.sumo_networks.config import Config
from dohyo.sumo_networks.errors import InvalidInputError

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


def train_to_the_end(trainer: Trainer[Any], name: str, config: RunConfig, folder: Path) -> None:
    """Begins or resumes the training of a folder on a task, unless it has taken its steps; for studies.

    Raises:
        InvalidInputError: The folder holds a training of another trainer or configuration, or one of more steps.
        RunStoppedError: The training was stopped.
    """
    from dohyo.agents.learning.runs.run import FREE, stored_config  # torch is slow to import: only if needed

    stored = stored_config(folder, name)
    if stored is not None and _has_ended(folder, (before := read_settings(type(config), stored)).steps):
        # More steps may be added to a training, and none taken away.
        if changed := differences(before, config, FREE if before.steps < config.steps else FREE - {"steps"}):
            raise InvalidInputError(f"the run in '{folder}' was started with {'; '.join(changed)}")
        if before.steps == config.steps:
            return
    trainer.train(config, TrainRequest(name, folder, stored is not None, no_report))


def _has_ended(folder: Path, steps: int) -> bool:
    """Whether a run has taken its steps; one that was extended and killed may have the result of its first end."""
    result = folder / "result.json"
    found = json.loads(result.read_text()) if result.exists() else {"finished": False}
    return bool(found["finished"]) and int(found["steps"]) >= steps
