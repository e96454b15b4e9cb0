"""Study `priboot`: rows 19 and 20 of the thesis's comparisons, on networks that no arm was trained on.

    python -m dohyo.agents.studies priboot run --set runs=out/priboot --arms full --only nocrash
    python -m dohyo.agents.studies priboot run --set runs=out/priboot train=false   # drives what is trained so far
    python -m dohyo.agents.studies priboot table --rows out/studies/priboot

A training is RUNS/TRAINING/seed-N, as `dohyo train priboot` makes it.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Final

from dohyo.agents.learning.files.card import read_cards
from dohyo.agents.learning.files.report import no_report
from dohyo.agents.learning.runs.trainer import TrainRequest
from dohyo.agents.priboot.study import tables
from dohyo.agents.priboot.study.arms import ARMS, config, lineage
from dohyo.agents.priboot.study.measures import measures
from dohyo.agents.priboot.training.train import PRIBOOT
from dohyo.agents.registry import resolve_with
from dohyo.agents.studies.arms import TRAININGS, Block, Cell, cells_of
from dohyo.agents.studies.driving import driven
from dohyo.agents.studies.rows import Row
from dohyo.agents.studies.runner import Job
from dohyo.agents.studies.samples import Sample, places_of, scenario_of
from dohyo.agents.studies.study import Study
from dohyo.agents.studies.trained import TrainedOptions
from dohyo.evaluation.agent import make_agent

POLICY: Final = "priboot.onnx"
SAMPLES: Final = (Sample("nocrash", ("town-test.regular.test",)), Sample("leaderboard", ("adlershof",)))


class Options(TrainedOptions):
    """Options of a run, see `TrainedOptions`."""

    runs: Path = Path("out/priboot")


def cells(options: Options) -> list[Cell]:
    """Every arm on both networks; the autopilot has no training."""
    places = places_of(SAMPLES)
    return cells_of(Block((name,), TRAININGS if arm.training else (None,), places) for name, arm in ARMS.items())


def work(options: Options, job: Job) -> Iterator[Row]:
    """Trains the arm of a job, unless that is done, and drives its scenario.

    Raises:
        RunStoppedError: The training was stopped.
        SimulationError: There is no policy yet and none may be trained, or a simulation failed.
    """
    arm, seed = ARMS[job[0].arm], job[0].training_seed
    name, settings, trained = "autopilot", {}, Row()
    if seed is not None:
        train = partial(train_to_the_end, options.runs, arm.training, seed)
        policy = options.trained(f"{arm.training}/seed-{seed}", train, POLICY)
        name, settings, trained = "priboot", {"rules": arm.rules, "policy": str(policy)}, losses_of(policy.parent)
    record, _ = driven(scenario_of(job[0]), make_agent(*resolve_with(name, settings)))
    yield {**trained, **measures(record.egos[0])}


def trainings(cell: Cell) -> list[str]:
    """Trainings behind a cell; arms share them."""
    seed = cell.training_seed
    return [] if seed is None else [f"{name}/seed-{seed}" for name in lineage(ARMS[cell.arm].training)]


def train_to_the_end(runs: Path, training: str, seed: int, folder: Path) -> None:
    """Begins or resumes a training, unless its network is there; first the one whose weights it begins from."""
    if (folder / POLICY).exists():
        return
    for first in lineage(training)[:-1]:
        train_to_the_end(runs, first, seed, runs / first / f"seed-{seed}")
    settings = config(training, seed, runs)
    PRIBOOT.train(settings, TrainRequest("priboot", folder, (folder / "config.toml").exists(), no_report))


def losses_of(folder: Path) -> Row:
    """Measures of a training on held-out drives, and its number of moments, from its card."""
    metrics = read_cards(folder)["priboot"].metrics
    assert not isinstance(metrics, str)
    return {name: metrics[name] for name in (*tables.LOSSES, *tables.STARTS, "moments") if name in metrics}


def _sizes(options: Options) -> dict[str, object]:
    """What the demonstrations were ordered as."""
    path = options.runs / "demonstrations" / "dataset.json"
    return {"demonstrations": json.loads(path.read_text())} if path.exists() else {}


STUDY = Study(
    summary="PRIBOOT: augmentation, colours against masks, rules, amounts of data, and the infraction rate score",
    room=Path(__file__).parents[1],
    options=Options,
    cells=cells,
    work=work,
    tables={
        "arms": tables.arms_table,
        "claims": tables.claims,
        "infractions": tables.infractions_table,
        "lengths": tables.lengths_table,
    },
    trainings=trainings,
    facts=_sizes,
    judged=tables.judged,
)
