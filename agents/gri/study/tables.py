"""Tables of the study: returns by arm, curves of the trainings, and verdicts on the thesis's directions."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Final

from dohyo.agents.gri.study.arms import ARMS, PROBLEMS
from dohyo.agents.studies.claims import Claim, above, of_ablation
from dohyo.agents.studies.crossed_bootstrap import Matched, by_training
from dohyo.agents.studies.rows import Row, by_arm, grouped, matched
from dohyo.agents.studies.study import Results, judging
from dohyo.agents.studies.tables import claims_section, mean_of
from dohyo.evaluation.report.style import MISSING, markdown

LAST, CURVE = "last", "curve"
"""Rows of a training's last policy, and of its evaluations."""
EARLY: Final = "early"
"""The first third of a curve, without its start: the warm-up of the thesis."""


def expert_of(problem: str) -> str:
    """Name of the arm of a problem's expert."""
    return f"{problem}-expert"


def _claims(problem: str, alone: str) -> list[Claim]:
    """Directions of the thesis on one problem.

    Args:
        problem: Its name.
        alone: Arm without demonstrations.
    """
    base, last, early = alone.removesuffix("p0"), f"{problem}, {LAST}", f"{problem}, {EARLY}"
    share = {"sac": 1, "ddpg": 2}.get(ARMS[alone].algorithm, 4)
    found = [Claim(f"{base}p{some}", ">", alone, "return", last, ablation=share) for some in (10, 20)]
    found += [Claim(f"{base}p60", "<", f"{base}p20", "return", last, ablation=share)]
    found += [Claim(f"{base}p100", "<", alone, "return", last, ablation=share)]
    found += [Claim(f"{base}p{some}", "<", alone, "return", early, ablation=share) for some in (20, 40, 60)]
    found += [Claim(f"{base}noise{some}", "=", f"{base}p20", "return", last, ablation=3) for some in (10, 30)]
    found += [Claim(f"{base}p25", ">", alone, "completed", last, ablation=4)]
    return [*found, Claim(f"{base}sqil", "<", f"{base}p25", "completed", last, ablation=4)]


_ENCODERS: Final = tuple(f"driving-vis-iqn-{name}" for name in ("affordances", "classification", "untrained"))
"""From the richest to the poorest."""
CLAIMS: Final = (
    *(
        claim
        for name, arm in ARMS.items()
        if name.endswith("-p0")
        for claim in _claims(arm.problem, name)
        if claim.left in ARMS and claim.right in ARMS
    ),
    *of_ablation(5, *above(*_ENCODERS, measure="completed", where=f"driving-vis, {LAST}")),
)


def shares(results: Results) -> str:
    """A row per arm: its last policies, and what was in their replays."""
    lines, rows = [], grouped(results.kept, "benchmark")
    for problem, found in PROBLEMS.items():
        for arm, mine in by_arm(rows.get(f"{problem}, {LAST}", ()), [expert_of(problem), *ARMS]).items():
            told = ARMS[arm].told if arm in ARMS else "expert"
            completed = mean_of((row for row in mine if "completed" in row), arm, "completed")
            lines.append([found.env, told, *_trained(mine), mean_of(mine, arm, "return"), completed])
    weight = "weight of demonstrations in the replay, %"
    heads = ["task", "arm", "trainings", "steps", weight, "return", "route completed, %"]
    return markdown(heads, lines) if lines else ""


def _trained(rows: Sequence[Row]) -> list[str]:
    """Trainings, steps and mean weight of demonstrations in the replay: of their steps, or of their priorities."""
    trainings = {row["training_seed"]: row for row in rows}
    steps = f"{rows[0]['steps']:,}" if rows[0]["steps"] else MISSING
    if None in trainings:
        return [MISSING, steps, MISSING]
    stored = [100.0 * row["replay_demonstrated"] for row in trainings.values()]
    return [f"{len(trainings)}", steps, f"{sum(stored) / len(stored):.0f}"]


def curves(results: Results) -> str:
    """A table per task: mean returns of the evaluations, over the trainings of each arm."""
    parts, rows = [], grouped(results.kept, "benchmark")
    for problem, found in PROBLEMS.items():
        there = rows.get(f"{problem}, {CURVE}", ())
        steps, lines = sorted(grouped(there, "seed")), []
        for arm, mine in by_arm(there, ARMS).items():
            values = [[row["return"] for row in mine if row["seed"] == step] for step in steps]
            lines.append([ARMS[arm].told, *(f"{sum(one) / len(one):.0f}" if one else MISSING for one in values)])
        if lines:
            parts.append(f"{found.env}\n\n" + markdown(["steps", *(f"{step:,}" for step in steps)], lines))
    return "\n\n".join(parts)


def _at(row: Row, place: str) -> bool:
    """Whether a row is of a benchmark; of the warm-up, whether it is of the curve's first third."""
    problem, _, part = place.partition(", ")
    benchmark: str = row["benchmark"]
    if part != EARLY:
        return benchmark == place
    return benchmark == f"{problem}, {CURVE}" and bool(0 < row["seed"] <= row["steps"] / 3)


def _values(rows: Iterable[Row], arm: str, measure: str) -> Matched:
    """Values by episode; the evaluations of a warm-up are one value of each training."""
    found = matched(rows, arm, measure)
    warm_up = any(benchmark.endswith(CURVE) for benchmark, *_ in found)
    return {(EARLY,): by_training(found)} if warm_up else found


judged = judging(CLAIMS, at=_at, values=_values)
claims = claims_section(judged, ("claim", "on", "measure"))
