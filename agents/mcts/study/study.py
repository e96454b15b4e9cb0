"""Study `mbappe`: ablations and baselines, on excerpts of recorded traffic and on whole routes.

    python -m dohyo.agents.studies mbappe run --workers 2 [--only val14/ nocrash]
    python -m dohyo.agents.studies mbappe table --rows out/studies/mbappe

The planner is developed on the odd missions of a benchmark of excerpts (`--set look=true`); the published tables are of
even ones.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

from dohyo.agents.mcts.study.measures import of_excerpt, of_route
from dohyo.agents.mcts.study.tables import judged, section
from dohyo.agents.studies.arms import Arm, Block, Cell, cells_of
from dohyo.agents.studies.driving import driven
from dohyo.agents.studies.rows import Row
from dohyo.agents.studies.runner import Job
from dohyo.agents.studies.samples import Sample, scenario_of
from dohyo.agents.studies.study import Study
from dohyo.agents.studies.tables import PAGE
from dohyo.evaluation.benchmarks.benchmark import load_benchmark
from dohyo.evaluation.benchmarks.traffic_logs import prepare_logs
from dohyo.evaluation.scores.nuplan.score import closed_loop
from dohyo.sumo_networks.config import Config
from dohyo.sumo_networks.networks.catalog import load_network


def _mbappe(reported: float | None = None, **settings: Any) -> Arm:
    return Arm("mbappe", MappingProxyType(settings), reported=reported)


THESIS: Mapping[str, Any] = MappingProxyType(
    {
        "crafted": "limit", "steering": "wheel", "simulator": "thesis", "walks": "node", "first_play": "zero",
        "choice": "visits", "early_stop": True, "reuse": False, "emergency": False, "caution": False, "passing": False,
    }
)  # fmt: skip
"""The thesis's planner whole, see CHOICES.md: its grid, priors, reward and search, and none of our additions."""
ARMS: Mapping[str, Arm] = MappingProxyType(
    {
        "autopilot": Arm("autopilot"),
        "mbappe": _mbappe(86),
        "prior-none": _mbappe(26, prior="none"),
        "prior-learned": _mbappe(65, prior="learned"),
        "prior-crafted": _mbappe(82, prior="crafted"),
        "constraints-none": _mbappe(79, constraints="none"),
        "constraints-tree": _mbappe(82, constraints="tree"),
        "constraints-node": _mbappe(82, constraints="node"),
        "predictor-constant_velocity": _mbappe(predictor="constant_velocity"),
        "predictor-idm": _mbappe(predictor="idm"),
        "alone-constant_velocity": Arm("predictor-only", MappingProxyType({"predictor": "constant_velocity"})),
        "alone-idm": Arm("predictor-only", MappingProxyType({"predictor": "idm"})),
        "alone-learned": Arm("predictor-only", MappingProxyType({"predictor": "learned"}), reported=47),
        "hold-0.1s": _mbappe(hold_s=0.1),
        "thesis-crafted": _mbappe(crafted="limit", first_play="zero", choice="visits", reuse=False, passing=False),
        "thesis-wheel": _mbappe(steering="wheel", passing=False),
        "thesis": _mbappe(86, **THESIS),
        "thesis-prior-none": _mbappe(26, prior="none", **THESIS),
        "thesis-prior-learned": _mbappe(65, prior="learned", **THESIS),
        "thesis-prior-crafted": _mbappe(82, prior="crafted", **THESIS),
        "learned-everywhere": _mbappe(learned_prior_s=8.0),
        "no-reuse": _mbappe(reuse=False),
        "choice-q": _mbappe(choice="q"),
        "choice-visits": _mbappe(choice="visits"),
        "value-network": _mbappe(value="network"),
        "random-shooting": Arm("random-shooting"),
        "idm": Arm("idm", reported=76),
        "pdm-closed": Arm("pdm-closed"),
        "pdm-published": Arm("pdm-closed", MappingProxyType({"variant": "published"}), reported=92),
    }
)
"""The base is `mbappe`: both priors, both constraints, the learned predictor, 1 s hold. Reported: the thesis's score on
nuPlan's Val14, %."""
PLANNERS = ("autopilot", "mbappe", "pdm-closed")
PER_TYPE = 1
"""Excerpts of each of the 14 types on `val14`. More are the same ones and others, so that a larger number drives only
the others."""
DRIVEN: Mapping[str, tuple[Sample, tuple[str, ...]]] = MappingProxyType(
    {
        "val14": (Sample("val14", remainder=0, per_type=PER_TYPE), tuple(ARMS)),
        "val14-reactive": (
            Sample("val14-reactive", remainder=0, per_type=5),
            ("autopilot", "mbappe", "idm", "pdm-closed"),
        ),
        "nocrash town-test.dense.test": (Sample("nocrash", ("town-test.dense.test",)), PLANNERS),
        "nocrash town-test.dense.train": (Sample("nocrash", ("town-test.dense.train",)), PLANNERS),
        "leaderboard": (Sample("leaderboard"), PLANNERS),
    }
)
"""Scenarios and arms of each section of RESULTS.md."""


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
    for name in dict.fromkeys(cell.benchmark for cell in wanted):
        scenarios = [scenario_of(cell) for cell in wanted if cell.benchmark == name]
        prepare_logs(scenarios, load_benchmark(name).reference_agent, workers)


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
    stored=Path(__file__).parents[1].joinpath("results") / "drives",
    page=Path(__file__).parents[1].joinpath(PAGE),
    options=Options,
    cells=cells,
    work=work,
    tables={name: section(sample, {arm: ARMS[arm] for arm in arms}) for name, (sample, arms) in DRIVEN.items()},
    prepare=prepare,
    judged=judged,
)
