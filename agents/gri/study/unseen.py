"""Study `griad`: row 4 where the thesis makes its claim, in NoCrash's unseen town under unseen conditions.

    python -m dohyo.agents.studies griad run --set runs=out/gri --arms driving-full-iqn-p25 --trainings 0
    python -m dohyo.agents.studies griad table --rows out/studies/griad

Arms and trainings are those of the study `gri` on driving with 100,000 steps: whichever study comes first trains them.
The last policy of a training drives, on the same missions as all others.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Final

import torch

from dohyo.agents.endless_driving.study.judging import measures
from dohyo.agents.endless_driving.study.tables import PER_KM, TRAFFIC, of_traffic
from dohyo.agents.gri.study import study
from dohyo.agents.gri.study.arms import ARMS, PROBLEMS, GriArm
from dohyo.agents.gri.study.study import Options, policy_of
from dohyo.agents.registry import resolve
from dohyo.agents.studies.arms import Block, Cell, cells_of
from dohyo.agents.studies.claims import Claim, of_ablation
from dohyo.agents.studies.driving import driven
from dohyo.agents.studies.rows import Row, by_arm, infractions_per_km
from dohyo.agents.studies.runner import Job
from dohyo.agents.studies.samples import Sample, scenario_of
from dohyo.agents.studies.study import Results, judging
from dohyo.agents.studies.tables import claims_section, mean_of, rounded
from dohyo.agents.studies.trained import own_trainings, result_of
from dohyo.evaluation.agent import Agent, make_agent
from dohyo.evaluation.report.style import markdown

PROBLEM: Final = "driving-full"
DRIVERS: Final[Mapping[str, GriArm]] = MappingProxyType(
    {name: arm for name, arm in ARMS.items() if arm.problem == PROBLEM}
)
UNSEEN: Final = Sample("nocrash", tuple(f"town-test.{traffic}.test" for traffic in TRAFFIC))
REPORTED: Final[Mapping[str, tuple[float, ...]]] = MappingProxyType(
    {
        f"{PROBLEM}-iqn-p0": (60.6, 59.3, 40.0),
        f"{PROBLEM}-iqn-p0-long": (62.0, 56.7, 46.0),
        f"{PROBLEM}-iqn-p25": (68.7, 63.3, 52.0),
        f"{PROBLEM}-iqn-p100": (0.0, 0.0, 0.0),
        f"{PROBLEM}-iqn-sqil": (0.0, 0.0, 0.0),
    }
)
"""Success in the thesis's unseen town and weather, %, by traffic (table 4.2 and its text)."""


def _claims() -> Iterator[Claim]:
    griad, alone = f"{PROBLEM}-iqn-p25", f"{PROBLEM}-iqn-p0"
    for traffic in TRAFFIC:
        yield Claim(griad, ">", alone, "success", traffic)
    yield Claim(griad, ">", alone, "success")
    yield Claim(griad, ">", f"{alone}-long", "success")
    yield Claim(f"{PROBLEM}-iqn-sqil", "<", griad, "success")
    yield Claim(f"{PROBLEM}-iqn-p100", "<", alone, "success")


CLAIMS: Final = of_ablation(4, *_claims())


def cells(options: Options) -> list[Cell]:
    """Missions of the unseen town, of each training."""
    return cells_of([Block([*DRIVERS], PROBLEMS[PROBLEM].trainings, UNSEEN.places())])


def work(options: Options, job: Job) -> Iterator[Row]:
    """Trains the arm of a job, unless that is done, and drives its last policy.

    Raises:
        RunStoppedError: The training was stopped.
        SimulationError: There is no policy so far, or a simulation failed.
    """
    torch.set_num_threads(1)
    policy = policy_of(options, job[0])
    facts = result_of(policy.parent, "steps", "updates")
    for cell in job:
        yield {**cell._asdict(), **facts, **measures(*driven(scenario_of(cell), driver(policy)))}


def driver(policy: Path) -> Agent:
    """GRIAD with a policy."""
    return make_agent(resolve("griad"), {"policy": str(policy)})


def success(results: Results) -> str:
    """A row per arm: success by traffic beside the thesis's, and the route completed."""
    lines = []
    for arm, own in by_arm(results.kept, DRIVERS).items():
        count = len({row["training_seed"] for row in own})
        shown = [mean_of(of_traffic(own, traffic), arm, "success") for traffic in TRAFFIC]
        completion = mean_of(own, arm, "route_completion")
        told = " / ".join(f"{value:g}" for value in REPORTED[arm])
        steps = f"{own[0]['steps']:,}"
        lines.append([DRIVERS[arm].told, f"{count}", steps, f"{len(own)}", *shown, completion, told])
    heads = ["arm", "trainings", "steps", "drives", *(f"{one}, %" for one in TRAFFIC), "route completed, %"]
    return markdown([*heads, f"thesis: {' / '.join(TRAFFIC)}"], lines) if lines else ""


def infractions(results: Results) -> str:
    """Infractions of each arm per km driven, in all traffic."""
    lines = []
    for arm, own in by_arm(results.kept, DRIVERS).items():
        km, found = infractions_per_km(own)
        rates = [f"{found[kind]:.2f}" for kind in PER_KM]
        lines.append([DRIVERS[arm].told, f"{km:.1f}", *rates])
    return markdown(["arm", "km", *PER_KM.values()], lines) if lines else ""


def _there(row: Row, where: str) -> bool:
    return where == "" or bool(of_traffic([row], where))


judged = judging(CLAIMS, at=_there)
STUDY: Final = replace(
    study.STUDY,
    summary="GRIAD in NoCrash's unseen town under unseen conditions, beside its algorithm alone",
    cells=cells,
    work=work,
    tables={
        "unseen": success,
        "unseen-infractions": infractions,
        "unseen-claims": claims_section(judged, ("claim", "on"), shown=rounded),
    },
    together=lambda cell: (cell.arm, cell.training_seed, cell.scenario.rpartition(".")[0]),
    trainings=own_trainings,
    judged=judged,
    published="unseen",
)
