"""Study `ghrl-trainings`: every training behind GHRL's tables, and their curves. The same command resumes.

    python -m dohyo.agents.studies ghrl-trainings run --set runs=runs/study --workers 2
    python -m dohyo.agents.studies ghrl-trainings run --arms p-5 p-20 --only training/lights
    python -m dohyo.agents.studies ghrl-trainings table --write
    python -m dohyo.agents.studies ghrl-trainings figures

Each is a run RUNS/ARM/seed-N/POLICY as `dohyo train` makes it, in a process of its own; masters come after the
sub-policies that they choose among.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from dohyo.agents.hierarchical.study import arms
from dohyo.agents.hierarchical.study.arms import ARMS, FLAT, MASTER, POLICIES, SUB_POLICIES, config_of, trainer_of
from dohyo.agents.learning.runs.config import RunConfig
from dohyo.agents.learning.runs.trainer import train_to_the_end
from dohyo.agents.studies.arms import Block, Cell, Place, cells_of
from dohyo.agents.studies.curves import draw
from dohyo.agents.studies.rows import Row
from dohyo.agents.studies.runner import Job
from dohyo.agents.studies.study import Results, Study
from dohyo.agents.studies.training_results import BENCHMARK, find_trainings, read_trainings, run_folder, table
from dohyo.evaluation.report.pictures import write_page

SHOWN, DRAWN = ("ghrl", "ghrl-r", "hrl", "flat", "flat-guided", "ghrl-pictures"), ("ghrl", "ghrl-r", "hrl")
"""Arms of the table, and of the picture."""


class Options(arms.Options):
    """Options of a run of trainings.

    Attributes:
        settings: Settings of all trainings on top of their arms', as "key=value".
    """

    settings: tuple[str, ...] = ()


def cells(options: Options) -> list[Cell]:
    """Every training of the published tables."""
    return cells_of(
        (
            Block(("ghrl", "hrl"), (0, 1, 2), _places(*SUB_POLICIES, MASTER)),
            Block(("ghrl-pictures",), (0,), _places(*SUB_POLICIES, MASTER)),
            Block(("ghrl-r",), (0, 1, 2), _places(MASTER)),
            Block(("p-5", "p-10", "p-20", "p-10-sum"), (0, 1, 2), _places("lights")),
            Block(("p-5", "p-10", "p-10-sum"), (0,), _places("lane", "braking")),
            Block(("p-20",), (0, 1, 2), _places("lane")),
            Block(("p-20",), (0,), _places("braking")),
            Block(("flat",), (0,), _places(FLAT)),
            Block(("flat-guided",), (0, 1), _places(FLAT)),
        )
    )


def _places(*policies: str) -> list[Place]:
    return [Place(BENCHMARK, policy, None) for policy in policies]


def check(options: Options, wanted: Sequence[Cell], workers: int) -> None:
    """Raises InvalidInputError if a setting does not exist, or its value is wrong, before anything is trained."""
    for cell in wanted:
        _config(options, cell)


def _config(options: Options, cell: Cell) -> RunConfig:
    return config_of(options.runs, cell.arm, cell.training_seed or 0, cell.scenario, options.settings)


def work(options: Options, job: Job) -> Iterator[Row]:
    """Begins or resumes a training, unless it is complete.

    Raises:
        RunStoppedError: After SIGINT or SIGTERM.
    """
    (cell,) = job
    folder = run_folder(options.runs, cell.arm, cell.training_seed or 0, cell.scenario)
    trainer = trainer_of(cell.scenario)
    train_to_the_end(trainer, f"hierarchical-{cell.scenario}", _config(options, cell), folder)
    yield {"folder": str(folder)}


def trainings_table(results: Results) -> str:
    """Last and best evaluation of each arm."""
    return table(read_trainings(results, SHOWN, POLICIES))


def figures(results: Results, out: Path) -> Sequence[Path]:
    """Curves of returns of held-out episodes."""
    told = {arm: one.isolates for arm, one in ARMS.items()}
    drawn = draw(read_trainings(results, DRAWN, POLICIES), told)
    return write_page(drawn, out / "curves.html", "How GHRL's policies learned")


STUDY = Study(
    summary="GHRL's trainings, and their curves",
    room=Path(__file__).parents[1],
    published="training",
    options=Options,
    cells=cells,
    work=work,
    tables={"trainings": trainings_table},
    prepare=check,
    fresh=True,
    phase=lambda cell: int(cell.scenario == MASTER),
    read=lambda folder: find_trainings(folder, POLICIES),
    figures=figures,
)
