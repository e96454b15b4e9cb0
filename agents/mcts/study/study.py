"""Study `mbappe`: ablations and baselines, on excerpts of recorded traffic and on whole routes.

    python -m dohyo.agents.studies mbappe run --workers 2 [--only val14/ nocrash]
    python -m dohyo.agents.studies mbappe table --rows out/studies/mbappe

The planner is developed on the odd missions of a benchmark of excerpts (`--set look=true`); the published tables are of
even ones.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from dohyo.agents.mcts.study.arms import ARMS, DRIVEN
from dohyo.agents.mcts.study.measures import of_excerpt, of_route
from dohyo.agents.mcts.study.tables import judged, section
from dohyo.agents.studies.arms import Block, Cell, cells_of
from dohyo.agents.studies.driving import driven, prepare_excerpts
from dohyo.agents.studies.rows import Row
from dohyo.agents.studies.runner import Job
from dohyo.agents.studies.samples import scenario_of
from dohyo.agents.studies.study import Study
from dohyo.evaluation.scores.nuplan.score import closed_loop
from dohyo.sumo_networks.config import Config
from dohyo.sumo_networks.networks.catalog import load_network


class Options(Config):
    """Options of a run.

    Attributes:
        look: Whether to drive the odd missions of excerpts, on which the planner is developed, instead of even ones.
    """

    look: bool = False


def cells(options: Options) -> list[Cell]:
    """Every cell of the published tables."""
    return cells_of(
        Block(arms, (None,), (sample.other_half() if options.look else sample).places())
        for sample, arms in DRIVEN.values()
    )


def prepare(options: Options, wanted: Sequence[Cell], workers: int) -> None:
    """Makes the missing logs of recorded traffic."""
    prepare_excerpts(wanted, workers)


def work(options: Options, job: Job) -> Iterator[Row]:
    """Drives a scenario with an agent of its own.

    Raises:
        SimulationError: The simulation failed.
    """
    (cell,) = job
    scenario = scenario_of(cell)
    record, trajectory = driven(scenario, ARMS[cell.arm].make())
    ego, reference_m = record.egos[0], scenario.reference_m
    if reference_m is None or record.lost:
        measured = of_route(ego)
    else:
        measured = of_excerpt(closed_loop(record, trajectory, load_network(scenario.network), reference_m), ego)
    yield {"status": ego.status.value, **measured}


STUDY = Study(
    summary="MBAPPE's ablations and baselines on val14, nocrash and leaderboard",
    room=Path(__file__).parents[1],
    published="drives",
    options=Options,
    cells=cells,
    work=work,
    tables={name: section(sample, {arm: ARMS[arm] for arm in arms}) for name, (sample, arms) in DRIVEN.items()},
    prepare=prepare,
    judged=judged,
)
