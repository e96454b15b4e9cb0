"""Study `planners`: all excerpts of val14 on which no planner was developed, each planner beside its published form.

    python -m dohyo.agents.studies planners run --workers 2
    python -m dohyo.agents.studies planners table --write

The score is nuPlan's closed-loop score. Planners are developed on the odd missions of val14; these are the even ones.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Final

from dohyo.agents.mcts.study.arms import BEFORE, THESIS, is_trained
from dohyo.agents.mcts.study.measures import EXCERPTS, SHARES, of_excerpt
from dohyo.agents.mcts.study.tables import causes_table
from dohyo.agents.studies.arms import Arm, Block, Cell, cells_of
from dohyo.agents.studies.claims import Claim, Judgement, judge_rows
from dohyo.agents.studies.crossed_bootstrap import of_shares
from dohyo.agents.studies.driving import prepare_excerpts, scored_excerpt
from dohyo.agents.studies.rows import Row, by_arm, of_one_training
from dohyo.agents.studies.runner import Job
from dohyo.agents.studies.samples import Sample
from dohyo.agents.studies.study import Results, Study
from dohyo.agents.studies.tables import claims_section, mean_of
from dohyo.evaluation.report.style import MISSING, markdown
from dohyo.evaluation.statistics import mean_estimate
from dohyo.sumo_networks.config import Config

PUBLISHED: Final = MappingProxyType({"variant": "published"})
NO_LOOK: Final = MappingProxyType({"looks_ahead": False})
WAITS: Final = MappingProxyType({"drives_off": False})
ARMS: Final[Mapping[str, Arm]] = MappingProxyType(
    {
        "mbappe": Arm("mbappe", isolates="as shipped", reported=86),
        "mbappe-waits": Arm("mbappe", WAITS, isolates="may keep a plan to stand for ever"),
        "mbappe-no-look": Arm("mbappe", MappingProxyType({**WAITS, **NO_LOOK}), isolates="nor looks ahead"),
        "mbappe-before": Arm("mbappe", BEFORE, isolates="nor keeps its lane, nor leaves room to people"),
        "mbappe-thesis": Arm("mbappe", THESIS, isolates="the thesis's planner whole", reported=86),
        "pdm-closed": Arm("pdm-closed", isolates="as shipped", reported=93),
        "pdm-no-look": Arm("pdm-closed", NO_LOOK, isolates="does not look ahead"),
        "pdm-published": Arm("pdm-closed", PUBLISHED, isolates="as published", reported=93),
        "pdm-hybrid": Arm("pdm-hybrid", isolates="PDM-Closed, and a learned offset after 2 s", reported=93),
        "idm": Arm("idm", isolates="follows the lane", reported=76),
        "autopilot": Arm("autopilot", isolates="rules of all benchmarks"),
    }
)
"""Reported: the score of the theses and of Dauner et al. 2023 on nuPlan's Val14, %."""
SAMPLE: Final = Sample("val14", remainder=0)
CLAIMS: Final = (
    Claim("mbappe", ">", "mbappe-waits", "score"),
    Claim("mbappe-waits", ">", "mbappe-no-look", "score"),
    Claim("mbappe-no-look", ">", "mbappe-before", "score"),
    Claim("mbappe", ">", "mbappe-thesis", "score"),
    Claim("pdm-closed", ">", "pdm-no-look", "score"),
    Claim("pdm-closed", ">", "pdm-published", "score"),
    Claim("mbappe", ">", "pdm-closed", "score"),
    Claim("mbappe", ">", "idm", "score"),
    Claim("pdm-closed", ">", "idm", "score"),
)


class Options(Config):
    """The study has no options: the shipped planners drive."""


def cells(options: Options) -> list[Cell]:
    """All planners on all even excerpts."""
    return cells_of([Block([*ARMS], (None,), SAMPLE.places())])


def prepare(options: Options, wanted: Sequence[Cell], workers: int) -> None:
    """Makes the missing logs of recorded traffic."""
    prepare_excerpts(wanted, workers)


def work(options: Options, job: Job) -> Iterator[Row]:
    """Drives an excerpt.

    Raises:
        SimulationError: The simulation failed.
    """
    (cell,) = job
    ego, terms = scored_excerpt(cell, ARMS[cell.arm].make())
    yield {"status": ego.status.value, **of_excerpt(terms, ego)}


def scores_section(results: Results) -> str:
    """A row per planner: the score, and what it is made of."""
    lines = [
        [
            arm,
            ARMS[arm].isolates,
            *(mean_of(rows, arm, one, alone=of_shares if one in SHARES else mean_estimate) for one in EXCERPTS),
            f"{ARMS[arm].reported or MISSING}",
            str(len(rows)),
        ]
        for arm, rows in by_arm(results.kept, ARMS).items()
    ]
    return markdown(["planner", "", *EXCERPTS.values(), "nuPlan's Val14", "drives"], lines) if lines else ""


def causes_section(results: Results) -> str:
    """Points that each cause took from each planner."""
    return causes_table(results.kept, ARMS)


TRAINED: Final = frozenset(name for name, arm in ARMS.items() if is_trained(arm) or arm.agent == "pdm-hybrid")


def judged(results: Results) -> list[Judgement]:
    """The claims; those on planners with the shipped predictor are of one training."""
    return judge_rows(CLAIMS, of_one_training(results.rows, TRAINED))


STUDY: Final = Study(
    summary="planners on all excerpts of val14 that they were not developed on",
    room=Path(__file__).parents[1],
    options=Options,
    cells=cells,
    work=work,
    tables={
        "planners": scores_section,
        "planner-causes": causes_section,
        "planner-claims": claims_section(judged, ("claim", "n")),
    },
    prepare=prepare,
    judged=judged,
    published="planners",
)
