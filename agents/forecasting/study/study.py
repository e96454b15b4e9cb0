"""Study `forecasting`: the thesis's tables 6.1 to 6.4 on our freeway, with baselines, seeds and intervals.

    python -m dohyo.agents.studies forecasting run --set data=DIR
    python -m dohyo.agents.studies forecasting table --write

DIR is a folder of `dohyo dataset freeway`. Trained forecasters stay in the folder `models`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any, Literal

import torch

from dohyo.agents.forecasting.data.reading import read_data
from dohyo.agents.forecasting.study.arms import ARMS, COMPARED, EQUAL, Variant
from dohyo.agents.forecasting.study.lab import Lab
from dohyo.agents.forecasting.study.latency import of_network
from dohyo.agents.forecasting.study.tables import TABLES, judged
from dohyo.agents.studies.arms import TRAININGS, Block, Cell, Place, cells_of
from dohyo.agents.studies.rows import Row
from dohyo.agents.studies.runner import Job
from dohyo.agents.studies.study import Study
from dohyo.sumo_networks.config import Config
from dohyo.sumo_networks.errors import InvalidInputError

LATENCY = (*((name, 1) for name in COMPARED), *((f"sa-lstm{way}", 3) for way in ("", "-all-at-once", "-n-step")))
QUICK_RUNS = 2000


class Options(Config):
    """Options of a run.

    Attributes:
        data: Folder of days, or a table.
        steps: Of each phase of a training.
        models: Folder of the trained forecasters.
        learn: Days of the folder to learn from: whole ones in meso, or congested mornings in micro.
    """

    data: Path
    steps: int = 200
    models: Path = Path("out/forecasting")
    learn: Literal["train", "mornings"] = "train"

    @property
    def arms(self) -> Mapping[str, Variant]:
        """The arms that learn from these days."""
        return {"train": ARMS, "mornings": EQUAL}[self.learn]


@cache
def _lab(options: Options) -> Lab:
    torch.set_num_threads(1)
    data = read_data(options.data, learn=options.learn)
    if not data.measured_sets:
        raise InvalidInputError(f"'{data.source}': expected test days in easy/ and hard/, got none")
    return Lab(data, options.models, options.steps)


def cells(options: Options) -> list[Cell]:
    """Every arm, seed and day; simple forecasters and shipped ones have no seed."""
    data = _lab(options).data
    days = [Place(name, f"{day:02}", None) for name in data.measured_sets for day in range(len(data.sets[name]))]
    learned = [arm for arm, variant in options.arms.items() if variant.is_trained]
    once = [arm for arm in options.arms if arm not in learned]
    return cells_of((Block(once, (None,), days), *(Block(learned, (seed,), days) for seed in TRAININGS)))


def trainings(cell: Cell) -> Iterator[str]:
    """The training of a cell's arm, and those that it begins with; arms have the same names in all runs."""
    variant: Variant | None = {**ARMS, **EQUAL}[cell.arm]
    while variant is not None:
        yield f"{variant.arm}-{cell.training_seed}"
        variant = variant.first


def work(options: Options, job: Job) -> Iterator[Row]:
    """Trains a forecaster, unless it is stored, and measures it on every day of the job's sets."""
    lab, first = _lab(options), job[0]
    forecaster = lab.forecaster(options.arms[first.arm], first.training_seed or 0)
    for name in dict.fromkeys(cell.benchmark for cell in job):
        for day, measured in enumerate(lab.measures(forecaster, name)):
            yield {"benchmark": name, "scenario": f"{day:02}", **measured}


def facts(options: Options) -> Mapping[str, Any]:
    """Sizes of the data, times of trainings, and latencies."""
    lab = _lab(options)
    segments = len(lab.data.segments)
    measured = {(name, rows): of_network(name, segments, rows, QUICK_RUNS, 200) for name, rows in LATENCY}
    return {
        "seeds": TRAININGS,
        "steps": options.steps,
        "free_kmh": round(3.6 * lab.free_mps, 3),
        "segments": segments,
        "windows": {name: len(some) for name, some in lab.windows.items()},
        "stretches": {name: len(some) for name, some in lab.data.sets.items()},
        "training_s": round(lab.seconds, 1),
        "latency_ms": {
            f"{name}, {rows}": {where: round(one.core_ms, 3) for where, one in by.items()}
            for (name, rows), by in measured.items()
        },
    }


STUDY = Study(
    summary="forecasters: the thesis's tables 6.1 to 6.4",
    room=Path(__file__).parents[1],
    options=Options,
    cells=cells,
    work=work,
    tables=TABLES,
    judged=judged,
    together=lambda cell: (cell.arm, cell.training_seed),
    trainings=lambda cell: tuple(trainings(cell)),
    facts=facts,
)
