"""Studies where the thesis makes its claims: trained drivers in NoCrash's unseen town under unseen conditions.

Arms and trainings are those of the study `gri`: the study that comes first trains them. The last policy of a training
drives, on the same missions as all others.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Final

import torch

from dohyo.agents.endless_driving.study.judging import measures
from dohyo.agents.endless_driving.study.tables import PER_KM, TRAFFIC, of_traffic
from dohyo.agents.gri.study import study
from dohyo.agents.gri.study.arms import ARMS, PROBLEMS
from dohyo.agents.gri.study.study import Options, policy_of
from dohyo.agents.registry import resolve
from dohyo.agents.studies.arms import Block, Cell, cells_of
from dohyo.agents.studies.claims import Claim
from dohyo.agents.studies.crossed_bootstrap import of_shares
from dohyo.agents.studies.driving import driven
from dohyo.agents.studies.rows import Row, by_arm, infractions_per_km
from dohyo.agents.studies.runner import Job, row_each
from dohyo.agents.studies.samples import Sample, scenario_of
from dohyo.agents.studies.study import Results, Study, judging
from dohyo.agents.studies.tables import claims_section, mean_of, rounded
from dohyo.agents.studies.trained import own_trainings, result_of
from dohyo.evaluation.agent import Agent, make_agent
from dohyo.evaluation.report.style import MISSING, markdown

Reported = Mapping[str, tuple[float, ...]]
"""Numbers of the thesis by arm."""
UNSEEN: Final = Sample("nocrash", tuple(f"town-test.{traffic}.test" for traffic in TRAFFIC))


def unseen_study(
    problems: Sequence[str], claims: Sequence[Claim], reported: Reported, published: str, summary: str
) -> Study[Options]:
    """A study of all arms of some problems.

    Args:
        problems: Names in `PROBLEMS`.
        claims: What is decided; their places are amounts of traffic, or empty for all.
        reported: Success in the thesis's unseen town and conditions, %, by traffic, of the arms that it has.
        published: Folder of the stored rows, and first part of the tables' names.
        summary: See `Study`.
    """
    judged = judging(claims, at=_there)
    return replace(
        study.STUDY,
        summary=summary,
        cells=partial(cells, problems),
        work=work,
        tables={
            published: partial(success, reported),
            f"{published}-infractions": infractions,
            f"{published}-claims": claims_section(judged, ("claim", "on", "measure"), shown=rounded),
        },
        together=lambda cell: (cell.arm, cell.training_seed, cell.scenario.rpartition(".")[0]),
        trainings=own_trainings,
        judged=judged,
        published=published,
    )


def drivers(problem: str) -> list[str]:
    """Arms of a problem."""
    return [name for name, arm in ARMS.items() if arm.problem == problem]


def cells(problems: Sequence[str], options: Options) -> list[Cell]:
    """Missions of the unseen town, of each training."""
    return cells_of([Block(drivers(one), PROBLEMS[one].trainings, UNSEEN.places()) for one in problems])


def work(options: Options, job: Job) -> Iterator[Row]:
    """Trains the arm of a job, unless that is done, and drives its last policy.

    Raises:
        RunStoppedError: The training was stopped.
        SimulationError: There is no policy so far. A drive that fails is a lost row.
    """
    torch.set_num_threads(1)
    policy = policy_of(options, job[0])
    facts = result_of(policy.parent, "steps", "updates")

    def measured(cell: Cell) -> Row:
        return {**cell._asdict(), **facts, **measures(*driven(scenario_of(cell), driver(policy)))}

    yield from row_each(job, measured)


def driver(policy: Path) -> Agent:
    """GRIAD with a policy."""
    return make_agent(resolve("griad"), {"policy": str(policy)})


def success(reported: Reported, results: Results) -> str:
    """A row per arm: success by traffic beside the thesis's, and the route completed."""
    lines = []
    for arm, own in by_arm(results.kept, ARMS).items():
        count = len({row["training_seed"] for row in own})
        shown = [mean_of(of_traffic(own, traffic), arm, "success", alone=of_shares) for traffic in TRAFFIC]
        completion = mean_of(own, arm, "route_completion")
        told = " / ".join(f"{value:g}" for value in reported.get(arm, ())) or MISSING
        steps = f"{own[0]['steps']:,}"
        lines.append([ARMS[arm].told, f"{count}", steps, f"{len(own)}", *shown, completion, told])
    heads = ["arm", "trainings", "steps", "drives", *(f"{one}, %" for one in TRAFFIC), "route completed, %"]
    return markdown([*heads, f"thesis: {' / '.join(TRAFFIC)}"], lines) if lines else ""


def infractions(results: Results) -> str:
    """Infractions of each arm per km driven, in all traffic."""
    lines = []
    for arm, own in by_arm(results.kept, ARMS).items():
        km, found = infractions_per_km(own)
        rates = [f"{found[kind]:.2f}" for kind in PER_KM]
        lines.append([ARMS[arm].told, f"{own[0]['steps']:,}", f"{km:.1f}", *rates])
    return markdown(["arm", "steps", "km", *PER_KM.values()], lines) if lines else ""


def _there(row: Row, where: str) -> bool:
    return where == "" or bool(of_traffic([row], where))
