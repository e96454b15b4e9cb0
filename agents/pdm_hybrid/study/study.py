"""Study `pdm-hybrid`: does a learned offset make better plans, and does it cost anything on the road?

    dohyo dataset motion --out motion --hours 2.8
    dohyo dataset motion --out motion-held-out --hours 1.2 --networks town-test,ingolstadt
    python -m dohyo.agents.studies pdm-hybrid run --set data=motion held_out=motion-held-out runs=out/pdm-offset
    python -m dohyo.agents.studies pdm-hybrid table --write

Plans are judged by what the demonstrator, the autopilot, then drove in networks that no training has seen; drives by
the closed-loop score on excerpts of `val14`. Source of the claims: Dauner et al. 2023.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Final

from dohyo.agents.experts.pdm import PdmClosed
from dohyo.agents.learning.files.report import no_report
from dohyo.agents.learning.runs.trainer import TrainRequest
from dohyo.agents.mcts.predictors.dataset import Sample as MotionSample
from dohyo.agents.mcts.predictors.recording import HELD_OUT
from dohyo.agents.pdm_hybrid.agent import PdmHybrid
from dohyo.agents.pdm_hybrid.offset import KEPT_S, Offset
from dohyo.agents.pdm_hybrid.plans import make_planner
from dohyo.agents.pdm_hybrid.study.plans_judged import Plan, constant_velocity, drives_of, judged
from dohyo.agents.pdm_hybrid.training import OFFSET, OffsetConfig, samples_of
from dohyo.agents.studies.arms import TRAININGS, Block, Cell, Place, cells_of
from dohyo.agents.studies.claims import Claim
from dohyo.agents.studies.driving import prepare_excerpts, scored_excerpt
from dohyo.agents.studies.rows import Row, by_place
from dohyo.agents.studies.runner import Job
from dohyo.agents.studies.samples import Sample
from dohyo.agents.studies.study import Results, Study, judging
from dohyo.agents.studies.tables import claims_section, mean_of
from dohyo.agents.studies.trained import TrainedOptions
from dohyo.evaluation.agent import Agent
from dohyo.evaluation.report.style import markdown

PLANS: Final = "plans"
"""Benchmark of the rows of held-out plans."""
EPISODES: Final = 12
EXCERPTS: Final = Sample("val14", remainder=0, per_type=1)
MEASURES: Final = ("open_loop_score", "ade_m", "fde_2s_m", "fde_3s_m", "fde_5s_m", "fde_8s_m")
SCORES: Final = ("score", "collisions")


@dataclass(frozen=True, slots=True)
class PlanArm:
    """A planner.

    Attributes:
        told: What it is.
        planned: Whether its network sees PDM-Closed's plan; None without a network.
        kept_s: Time for which the plan is PDM-Closed's, s.
        drives: Whether it drives the excerpts, too.
    """

    told: str
    planned: bool | None = None
    kept_s: float = KEPT_S
    drives: bool = False


ARMS: Final[Mapping[str, PlanArm]] = MappingProxyType(
    {
        "constant-velocity": PlanArm("keeps speed and heading"),
        "pdm-closed": PlanArm("the rules alone", drives=True),
        "pdm-hybrid": PlanArm("the rules for 2 s, then a learned offset to them", True, drives=True),
        "offset-at-once": PlanArm("the learned offset from the first moment on", True, 0.0, drives=True),
        "pdm-open": PlanArm("a network of centreline and own motion alone", False, 0.0, drives=True),
    }
)
CLAIMS: Final = (
    Claim("pdm-hybrid", ">", "pdm-closed", "open_loop_score", PLANS),
    Claim("pdm-open", ">", "pdm-closed", "open_loop_score", PLANS),
    Claim("pdm-hybrid", "<", "pdm-closed", "fde_8s_m", PLANS),
    Claim("pdm-closed", ">", "pdm-open", "score", "val14"),
    Claim("pdm-closed", ">", "offset-at-once", "score", "val14"),
)
"""The source's: plans are better with the network, drives are better without."""


class Options(TrainedOptions):
    """Options of a run, see `TrainedOptions`.

    Attributes:
        data: Motion data set to learn from.
        held_out: Motion data set to judge plans by.
    """

    runs: Path = Path("out/pdm-offset")
    data: Path = Path("motion")
    held_out: Path = Path("motion-held-out")


def cells(options: Options) -> list[Cell]:
    """Every planner on the held-out episodes, and those that drive on an excerpt of each type."""
    episodes = [Place(PLANS, f"{HELD_OUT[i % 2]}-{i // 2:04d}", None) for i in range(EPISODES)]
    excerpts = EXCERPTS.places()
    blocks = (
        Block((name,), (None,) if arm.planned is None else TRAININGS, places)
        for name, arm in ARMS.items()
        for places in (episodes, excerpts)
        if places is episodes or arm.drives
    )
    return cells_of(blocks)


def prepare(options: Options, wanted: Sequence[Cell], workers: int) -> None:
    """Makes the missing logs of recorded traffic."""
    prepare_excerpts([cell for cell in wanted if cell.benchmark != PLANS], workers)


def work(options: Options, job: Job) -> Iterator[Row]:
    """Judges the plans of an episode, or drives an excerpt.

    Raises:
        InvalidInputError: A data set is missing.
        RunStoppedError: The training was stopped.
        SimulationError: There is no network yet and none may be trained, or a simulation failed.
    """
    (cell,) = job
    arm, policy = ARMS[cell.arm], None
    if arm.planned is not None:
        (name,) = trainings(cell)
        policy = options.trained(name, lambda folder: _train(options, cell, folder))
    if cell.benchmark == PLANS:
        yield judged(_drives(options.held_out / "test" / f"{cell.scenario}.npz"), _plan(cell.arm, policy))
    else:
        yield _driven(cell, _agent(arm, policy))


def trainings(cell: Cell) -> tuple[str, ...]:
    """Training of a cell, which arms share; empty for an arm without a network."""
    planned = ARMS[cell.arm].planned
    return () if planned is None else (f"{'hybrid' if planned else 'open'}/seed-{cell.training_seed}",)


def _train(options: Options, cell: Cell, folder: Path) -> None:
    """Begins or resumes a training, unless its network is there."""
    if not (folder / "best.onnx").exists():
        planned = bool(ARMS[cell.arm].planned)
        settings = OffsetConfig(data=options.data, seed=cell.training_seed or 0, planned=planned, tensorboard=False)
        OFFSET.train(settings, TrainRequest("pdm-offset", folder, (folder / "config.toml").exists(), no_report))


@cache
def _drives(shard: Path) -> list[list[MotionSample]]:
    return drives_of(samples_of(shard))


def _plan(name: str, policy: Path | None) -> Plan:
    if name == "constant-velocity":
        return constant_velocity
    closed = make_planner().plan_in
    if policy is None:
        return closed
    offset = Offset(policy, ARMS[name].kept_s)
    return lambda scene: offset(scene, closed(scene))


def _agent(arm: PlanArm, policy: Path | None) -> Agent:
    """The planner of an arm, as it was when the first of these drives were made."""
    if policy is None:
        return PdmClosed(looks_ahead=False)  # type: ignore[abstract]
    return PdmHybrid(policy=policy, kept_s=arm.kept_s, looks_ahead=False)  # type: ignore[abstract]


def _driven(cell: Cell, agent: Agent) -> Row:
    ego, terms = scored_excerpt(cell, agent)
    return {"status": ego.status.value, "score": terms.score, "collisions": 100.0 * (terms.no_collision < 1.0)}


def arms_table(results: Results) -> str:
    """Means over held-out episodes, and over excerpts."""
    plans = [row for row in results.kept if row["benchmark"] == PLANS]
    lines = [
        [arm, ARMS[arm].told, *(mean_of(rows, arm, one, 2) for one in MEASURES)]
        for _, arm, rows in by_place(plans, ARMS)
    ]
    heads = ["plans", "by", "open-loop score", "ADE, m", *(f"FDE at {s} s, m" for s in (2, 3, 5, 8))]
    drives = [row for row in results.kept if row["benchmark"] != PLANS]
    scores = [[arm, *(mean_of(rows, arm, one) for one in SCORES)] for _, arm, rows in by_place(drives, ARMS)]
    scored = markdown(["drives", "closed-loop score", "at-fault collision, %"], scores)
    return "\n\n".join((markdown(heads, lines), scored))


judged_claims = judging(CLAIMS)
STUDY = Study(
    summary="PDM-Hybrid: plans and drives with and without a learned offset",
    room=Path(__file__).parents[1],
    options=Options,
    cells=cells,
    work=work,
    tables={"arms": arms_table, "claims": claims_section(judged_claims, ("claim", "where", "measure", "n"))},
    trainings=trainings,
    prepare=prepare,
    judged=judged_claims,
)
