"""Study `priboot`: rows 19 and 20 of the thesis's comparisons, on networks that no arm was trained on.

    python -m dohyo.agents.studies priboot run --set runs=out/priboot --arms full --only nocrash
    python -m dohyo.agents.studies priboot run --set runs=out/priboot train=false   # drives what is trained so far
    python -m dohyo.agents.studies priboot table --rows out/studies/priboot

A training is RUNS/TRAINING/seed-N, as `dohyo train priboot` makes it.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from dohyo.agents.learning.files.card import read_cards
from dohyo.agents.learning.files.report import no_report
from dohyo.agents.learning.runs.trainer import TrainRequest
from dohyo.agents.priboot.study.arms import ARMS, config
from dohyo.agents.priboot.study.measures import measures
from dohyo.agents.priboot.study.tables import (
    LOSSES,
    STARTS,
    arms_table,
    claims,
    infractions_table,
    judged,
    lengths_table,
)
from dohyo.agents.priboot.training.train import PRIBOOT
from dohyo.agents.registry import resolve_with
from dohyo.agents.studies.arms import Block, Cell, cells_of
from dohyo.agents.studies.driving import driven
from dohyo.agents.studies.rows import Row
from dohyo.agents.studies.runner import Job
from dohyo.agents.studies.samples import Sample, scenario_of
from dohyo.agents.studies.study import Study
from dohyo.agents.studies.tables import PAGE
from dohyo.evaluation.agent import make_agent
from dohyo.sumo_networks.config import Config
from dohyo.sumo_networks.errors import SimulationError

SEEDS: Final = (0, 1, 2)
SAMPLES: Final = (Sample("nocrash", ("town-test.regular.test",)), Sample("leaderboard", ("adlershof",)))


class Options(Config):
    """Options of a run.

    Attributes:
        runs: Folder of all trainings.
        train: Whether trainings begin or resume; False: they are driven as they are.
    """

    runs: Path = Path("out/priboot")
    train: bool = True


def cells(options: Options) -> list[Cell]:
    """Every arm on both networks; the autopilot has no training."""
    places = [place for sample in SAMPLES for place in sample.places()]
    return cells_of(Block((name,), SEEDS if arm.training else (None,), places) for name, arm in ARMS.items())


def work(options: Options, job: Job) -> Iterator[Row]:
    """Trains the arm of a job, unless that is done, and drives its scenario.

    Raises:
        RunStoppedError: The training was stopped.
        SimulationError: There is no policy yet and none may be trained, or a simulation failed.
    """
    arm, seed = ARMS[job[0].arm], job[0].training_seed
    name, settings, trained = "autopilot", {}, Row()
    if seed is not None:
        folder = options.runs / arm.training / f"seed-{seed}"
        if options.train and not (folder / "priboot.onnx").exists():
            PRIBOOT.train(
                config(arm.training, seed),
                TrainRequest("priboot", folder, (folder / "config.toml").exists(), no_report),
            )
        if not (folder / "priboot.onnx").exists():
            raise SimulationError(f"no policy in '{folder}' so far")
        name, settings = "priboot", {"rules": arm.rules, "policy": str(folder / "priboot.onnx")}
        trained = losses_of(folder)
    yield {**trained, **drive(job[0], name, settings)}


def drive(cell: Cell, name: str, settings: dict[str, object]) -> Row:
    """Drives one scenario with an agent of its own.

    Raises:
        SimulationError: The simulation failed.
    """
    record, _ = driven(scenario_of(cell), make_agent(*resolve_with(name, settings)))
    return measures(record.egos[0])


def losses_of(folder: Path) -> Row:
    """Measures of a training on held-out drives, and its number of moments, from its card."""
    metrics = read_cards(folder)["priboot"].metrics
    assert not isinstance(metrics, str)
    return {name: metrics[name] for name in (*LOSSES, *STARTS, "moments") if name in metrics}


def _sizes(options: Options) -> dict[str, object]:
    """What the demonstrations were ordered as."""
    path = options.runs / "demonstrations" / "dataset.json"
    return {"demonstrations": json.loads(path.read_text())} if path.exists() else {}


STUDY = Study(
    summary="PRIBOOT: augmentation, colours against masks, rules, amounts of data, and the infraction rate score",
    stored=Path(__file__).parents[1] / "results",
    page=Path(__file__).parents[1] / PAGE,
    options=Options,
    cells=cells,
    work=work,
    tables={"arms": arms_table, "claims": claims, "infractions": infractions_table, "lengths": lengths_table},
    facts=_sizes,
    judged=judged,
)
