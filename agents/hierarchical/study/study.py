"""Study `ghrl`: arms of GHRL, trainings and scenarios of four benchmarks; NoCrash success and the work of the rules.

    python -m dohyo.agents.studies ghrl run --set runs=runs/study --workers 2
    python -m dohyo.agents.studies ghrl table --write

RUNS holds the trainings, ARM/seed-N, as `python -m dohyo.agents.studies ghrl-trainings run` makes them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from types import MappingProxyType

from dohyo.agents.hierarchical.study.arms import Options
from dohyo.agents.hierarchical.study.driving import drive
from dohyo.agents.hierarchical.study.gap import gap_section
from dohyo.agents.hierarchical.study.tables import arms_section, judged, lines_section, rows_of, unseen_section
from dohyo.agents.studies.arms import TRAININGS, Arm, Block, Cell, cells_of
from dohyo.agents.studies.rows import Row
from dohyo.agents.studies.runner import Job
from dohyo.agents.studies.samples import Sample, places_of, scenario_of
from dohyo.agents.studies.study import Study
from dohyo.evaluation.agent import Agent


def _ghrl(arm: str, trained: str, isolates: str, lines: bool = False) -> Arm:
    return Arm("ghrl", MappingProxyType({"arm": arm, "lines": lines}), trained, isolates)


ARMS: Mapping[str, Arm] = MappingProxyType(
    {
        "rules": Arm("rules", isolates="the teacher alone"),
        "hrl": _ghrl("hrl", "hrl", "PPO alone"),
        "ghrl": _ghrl("ghrl", "ghrl", "imitation and guidance"),
        "ghrl-r": _ghrl("ghrl-r", "ghrl", "rules drive in critical intervals"),
        "ghrl-r-lines": _ghrl("ghrl-r", "ghrl", "as shipped: rules drive before closed lines, too", lines=True),
        "ghrl-r-no-lines": _ghrl("ghrl-r", "ghrl", "the same code, whose RSS knows no lines"),
        "ghrl-r-trained": _ghrl("ghrl-r", "ghrl-r", "its master was trained while rules drove in critical intervals"),
        "ghrl-s": _ghrl("ghrl-s", "ghrl", "rules as a shield at all times"),
        "flat": _ghrl("flat", "flat", "one policy, PPO alone"),
        "flat-guided": _ghrl("flat", "flat-guided", "one policy, imitation and guidance"),
        "ghrl-pictures": _ghrl("ghrl", "ghrl-pictures", "pictures instead of the exact state"),
        "ghrl-r-pictures": _ghrl("ghrl-r", "ghrl-pictures", "pictures, and rules in critical intervals"),
    }
)
LINES = ("ghrl-r-lines", "ghrl-r-no-lines")
"""Arms that differ by the lines alone, driven by later code than all others."""
UNSEEN_TOWN = ("town-test.empty.test", "town-test.regular.test", "town-test.dense.test")
PRECRASH, OBSTACLES = Sample("precrash", every=2), Sample("obstacles", every=6)
NOCRASH = Sample("nocrash", UNSEEN_TOWN, every=3)
WHOLE = (Sample("nocrash"), Sample("obstacles"), Sample("endurance"))
UNSEEN_TRAFFIC = Sample("nocrash", ("town-test.dense.test",), seed=1, every=2)


def cells(options: Options) -> list[Cell]:
    """Every cell of the published tables."""
    three, two = places_of((PRECRASH, OBSTACLES, NOCRASH)), places_of((PRECRASH, NOCRASH))
    blocks = (
        Block(("rules",), (None,), two),
        Block(("hrl", "ghrl", "ghrl-r", "ghrl-r-trained"), TRAININGS, three),
        Block(("flat-guided",), (0, 1), three),
        Block(("flat", "ghrl-pictures", "ghrl-r-pictures"), (0,), three),
        Block(("ghrl-s",), (0,), two),
        Block(("ghrl-r",), (0,), places_of(WHOLE)),
        Block(("ghrl-r",), TRAININGS, UNSEEN_TRAFFIC.places()),
        Block(LINES, (0,), places_of((PRECRASH, Sample("nocrash"), UNSEEN_TRAFFIC))),
    )
    return cells_of(blocks)


def work(options: Options, job: Job) -> Iterator[Row]:
    """Drives the scenarios of a job."""
    for cell in job:
        yield {**cell._asdict(), **drive(_agent(cell.arm, cell.training_seed, options.runs), scenario_of(cell))}


@cache
def _agent(name: str, training_seed: int | None, runs: Path) -> Agent:
    """Agent of an arm, read once in each process."""
    arm = ARMS[name]
    return arm.make() if arm.trained is None else arm.make(checkpoint=str(runs / arm.trained / f"seed-{training_seed}"))


MAIN = ("rules", "hrl", "ghrl", "ghrl-r", "ghrl-s")
"""Arms of the first section, whose claims are corrected together."""
STUDY = Study(
    summary="GHRL's arms on precrash, obstacles, nocrash and endurance",
    room=Path(__file__).parents[1],
    published="drives",
    options=Options,
    cells=cells,
    work=work,
    tables={
        "benchmarks": arms_section(*MAIN),
        "other-arms": arms_section("ghrl", "ghrl-r-trained", "flat", "flat-guided", "ghrl-pictures", "ghrl-r-pictures"),
        "unseen-traffic": unseen_section,
        "lines": lines_section(*LINES),
        "gap": gap_section,
    },
    judged=lambda results: judged(rows_of(results, MAIN)),
)
