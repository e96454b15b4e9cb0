"""Trainers of `dohyo train`, by name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, TypeVar

from dohyo.agents.learning.report import Reporter
from dohyo.evaluation.entry import load_entry
from dohyo.sumo_networks.config import Config
from dohyo.sumo_networks.errors import InvalidInputError, UnknownNameError

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
        config: Its settings; those with an `out` choose the folder, unless the command does.
        train: Trains, and returns the resulting file.
    """

    summary: str
    config: type[C]
    train: Callable[[C, TrainRequest], Path]


# As "module:attribute", since trainers take seconds to import.
TRAINERS: dict[str, str] = {
    "predictor": "dohyo.agents.learning.predictor:PREDICTOR",
    "value": "dohyo.agents.learning.value:VALUE",
    "semantic": "dohyo.agents.hierarchical.vision.train:SEMANTIC",
    **{
        f"hierarchical-{name}": f"dohyo.agents.hierarchical.subpolicies:{name.upper()}"
        for name in ("lane", "left", "right")
    },
    **{
        f"hierarchical-{name}": f"dohyo.agents.hierarchical.subpolicies:{name.upper()}"
        for name in ("braking", "lights")
    },
    "hierarchical-flat": "dohyo.agents.hierarchical.subpolicies:FLAT",
    "hierarchical-master": "dohyo.agents.hierarchical.master_training:MASTER",
}


def trainer_named(name: str) -> Trainer[Any]:
    """The trainer of that name, or of that "module:attribute".

    Raises:
        UnknownNameError: There is no such trainer.
        InvalidInputError: There is no such module, or no trainer in it.
    """
    entry = TRAINERS.get(name, name)
    if ":" not in entry:
        raise UnknownNameError("trainer", name, TRAINERS)
    trainer = load_entry(entry, "trainer")
    if not isinstance(trainer, Trainer):
        raise InvalidInputError(f"'{entry}': expected a Trainer, got {type(trainer).__name__}")
    return trainer
