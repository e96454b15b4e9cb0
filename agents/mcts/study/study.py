"""Study `mbappe`: ablations and baselines, on excerpts of recorded traffic and on whole routes.

    python -m dohyo.agents.studies mbappe run --workers 2 [--only val14/ nocrash]
    python -m dohyo.agents.studies mbappe table --rows out/studies/mbappe

The planner is developed on the odd missions of a benchmark of excerpts (`--set look=true`); the published tables are of
even ones. Arms with the learned predictor drive with each of its trainings: 0 ships, the others are stored beside the
rows (`dohyo train predictor --config agents/mcts/predictors/checkpoints/motion.toml --set seed=1`).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

from dohyo.agents.mcts.mbappe import Mbappe
from dohyo.agents.mcts.predictor_only import PredictorOnly
from dohyo.agents.mcts.predictors.learned import Learned
from dohyo.agents.mcts.study.arms import ARMS, DRIVEN, TRAINED
from dohyo.agents.mcts.study.measures import of_excerpt, of_route
from dohyo.agents.mcts.study.tables import judged, section
from dohyo.agents.studies.arms import TRAININGS, Block, Cell, cells_of
from dohyo.agents.studies.driving import driven, prepare_excerpts
from dohyo.agents.studies.rows import Row
from dohyo.agents.studies.runner import Job
from dohyo.agents.studies.samples import Sample, scenario_of
from dohyo.agents.studies.study import Study
from dohyo.evaluation.agent import Agent
from dohyo.evaluation.scores.nuplan.score import closed_loop
from dohyo.sumo_networks.config import Config
from dohyo.sumo_networks.networks.catalog import load_network

ROOM = Path(__file__).parents[1]
TRAINED_ON: Final = "val14"
"""Benchmark that all trainings of the predictor drive; the others are driven with the one that ships."""


class Options(Config):
    """Options of a run.

    Attributes:
        look: Whether to drive the odd missions of excerpts, on which the planner is developed, instead of even ones.
        runs: Folder of the predictor's trainings but the first, as predictor/seed-N.
    """

    look: bool = False
    runs: Path = ROOM / "results" / "trainings"


def cells(options: Options) -> list[Cell]:
    """Every cell of the published tables."""
    return cells_of(block for sample, arms in DRIVEN.values() for block in _blocks(sample, arms, options.look))


def _blocks(sample: Sample, arms: Sequence[str], look: bool) -> Iterator[Block]:
    places = (sample.other_half() if look else sample).places()
    trained, others = ([arm for arm in arms if (arm in TRAINED) is side] for side in (True, False))
    yield Block(trained, TRAININGS if sample.benchmark == TRAINED_ON else TRAININGS[:1], places)
    yield Block(others, (None,), places)


def prepare(options: Options, wanted: Sequence[Cell], workers: int) -> None:
    """Makes the missing logs of recorded traffic."""
    prepare_excerpts(wanted, workers)


def work(options: Options, job: Job) -> Iterator[Row]:
    """Drives a scenario with an agent of its own.

    Raises:
        InvalidInputError: There is no such training of the predictor.
        SimulationError: The simulation failed.
    """
    (cell,) = job
    scenario = scenario_of(cell)
    record, trajectory = driven(scenario, agent_of(cell, options.runs))
    ego, reference_m = record.egos[0], scenario.reference_m
    if reference_m is None or record.lost:
        measured = of_route(ego)
    else:
        measured = of_excerpt(closed_loop(record, trajectory, load_network(scenario.network), reference_m), ego)
    yield {"status": ego.status.value, **measured}


def agent_of(cell: Cell, runs: Path) -> Agent:
    """The arm's agent, with the predictor of the cell's training.

    Raises:
        InvalidInputError: There is no such training in `runs`.
    """
    agent = ARMS[cell.arm].make()
    if cell.training_seed and isinstance(agent, Mbappe | PredictorOnly):
        agent.predictor = Learned(runs / "predictor" / f"seed-{cell.training_seed}" / "predictor.onnx")
    return agent


STUDY = Study(
    summary="MBAPPE's ablations and baselines on val14, nocrash and leaderboard",
    room=ROOM,
    published="drives",
    options=Options,
    cells=cells,
    work=work,
    tables={name: section(sample, {arm: ARMS[arm] for arm in arms}) for name, (sample, arms) in DRIVEN.items()},
    prepare=prepare,
    judged=judged,
)
