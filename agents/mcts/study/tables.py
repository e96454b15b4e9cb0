"""Tables of MBAPPE's study as Markdown: a row per arm, one per claim, one per cause of lost points."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from typing import Final

from dohyo.agents.mcts.study.arms import PLANNERS
from dohyo.agents.mcts.study.losses import CAUSES
from dohyo.agents.mcts.study.measures import EXCERPTS, ROUTES, SHARES
from dohyo.agents.studies.arms import Arm
from dohyo.agents.studies.claims import Claim, Judgement, above, judge_rows, of_ablation
from dohyo.agents.studies.crossed_bootstrap import of_shares
from dohyo.agents.studies.rows import Row, by_arm
from dohyo.agents.studies.samples import Sample
from dohyo.agents.studies.study import Results
from dohyo.agents.studies.tables import claims_table, mean_of, rounded
from dohyo.evaluation.report.style import markdown
from dohyo.evaluation.statistics import mean_estimate

_above = partial(above, measure="score")
CLAIMS: Final = (
    *of_ablation(
        6,
        *_above("prior-learned", "prior-none"),
        *_above("prior-crafted", "prior-learned"),
        *_above("mbappe", "prior-crafted", "prior-none"),
        *above("prior-learned", "prior-none", measure="collisions"),
        *_above("thesis-prior-learned", "thesis-prior-none"),
        *_above("thesis-prior-crafted", "thesis-prior-learned"),
        *_above("thesis", "thesis-prior-crafted", "thesis-prior-none"),
        *above("thesis-prior-learned", "thesis-prior-none", measure="collisions"),
    ),
    *of_ablation(
        7,
        *_above("constraints-tree", "constraints-none"),
        *_above("constraints-node", "constraints-none"),
        *_above("mbappe", "constraints-none", "constraints-tree", "constraints-node"),
    ),
    *of_ablation(
        8,
        *_above("predictor-idm", "predictor-constant_velocity"),
        *_above("mbappe", "predictor-idm", "predictor-constant_velocity", "alone-learned"),
        *_above("predictor-idm", "alone-idm"),
        *_above("predictor-constant_velocity", "alone-constant_velocity"),
        *_above("thesis", "alone-learned"),
    ),
    *of_ablation(9, *_above("mbappe", "hold-0.1s")),
    *_above("mbappe", "random-shooting", "idm", "choice-q", "choice-visits"),
    *_above("mbappe", "thesis-crafted", "thesis-wheel", "thesis", "no-reuse"),
    *_above("learned-everywhere", "mbappe"),
    *_above("value-network", "mbappe"),
    *_above("mbappe", "autopilot"),
    *_above("pdm-closed", "idm", "mbappe", "pdm-published"),
)
"""Claims on excerpts."""
ROUTE_CLAIMS: Final = (
    Claim("mbappe", ">", "autopilot", "nocrash_success"),
    Claim("mbappe", ">", "autopilot", "driving_score"),
    Claim("pdm-closed", ">", "autopilot", "nocrash_success"),
    Claim("pdm-closed", ">", "autopilot", "driving_score"),
    Claim("mbappe", ">", "pdm-closed", "driving_score"),
)
"""Claims on whole routes."""


def section(sample: Sample, arms: Mapping[str, Arm]) -> Callable[[Results], str]:
    """Section with the tables of one sample; empty without rows."""

    def written(results: Results) -> str:
        rows = [
            row
            for row in results.kept
            if row["benchmark"] == sample.benchmark
            and row["scenario"].startswith(sample.cells or "")
            and row["arm"] in arms
        ]
        look = results.facts.get("options", {}).get("look", False)
        return tables(sample.other_half() if look else sample, rows, arms) if rows else ""

    return written


def tables(sample: Sample, rows: Sequence[Row], arms: Mapping[str, Arm]) -> str:
    """The tables of one sample."""
    excerpts = sample.benchmark.startswith("val14")
    columns = EXCERPTS if excerpts else ROUTES
    parts = (
        f"On {_what(sample)}:",
        arms_table(rows, arms, columns, reported=sample.benchmark == "val14"),
        claims_table(
            judge_rows(CLAIMS if excerpts else ROUTE_CLAIMS, rows),
            ("claim", "metric", "n"),
            rounded,
            {"metric": lambda one: columns[one.claim.measure]},
        ),
        causes_table(rows),
    )
    return "\n\n".join(part for part in parts if part)


def arms_table(rows: Sequence[Row], arms: Mapping[str, Arm], columns: Mapping[str, str], reported: bool) -> str:
    """A row per arm, with the thesis's score if it is of this benchmark."""
    lines = []
    for name, own in by_arm(rows, arms).items():
        found = [mean_of(own, name, one, alone=of_shares if one in SHARES else mean_estimate) for one in columns]
        thesis = arms[name].reported
        theirs = ["" if thesis is None else f"{thesis}"] if reported else []
        lines.append([name, *found, *theirs, str(len(own))])
    return markdown(["arm", *columns.values(), *(["thesis"] if reported else []), "n"], lines)


def judged(results: Results) -> list[Judgement]:
    """The claims on excerpts of recorded traffic."""
    excerpts = [row for row in results.rows if row["benchmark"] == "val14"]
    return judge_rows(CLAIMS, excerpts)


def causes_table(rows: Sequence[Row], planners: Iterable[str] = PLANNERS) -> str:
    """Points that planners lost, by cause: on average, and in how many drives; empty for whole routes."""
    scored = by_arm((row for row in rows if "points" in row), planners)
    driven = {arm: [row["points"] for row in own] for arm, own in scored.items()}
    lines = []
    for cause, told in CAUSES.items():
        lost = {arm: [each[cause] for each in points if each[cause] > 0.0] for arm, points in driven.items()}
        if any(lost.values()):
            cells = [f"{sum(some) / len(driven[arm]):.1f} ({len(some)})" if some else "0" for arm, some in lost.items()]
            lines.append([told, *cells])
    return markdown(["points lost (in drives)", *driven], lines) if lines else ""


def _what(sample: Sample) -> str:
    half = {0: "even", 1: "odd"}
    told = [f"`{sample.benchmark}`"]
    told += [] if sample.remainder is None else [f"{half[sample.remainder]}-numbered missions"]
    told += [] if sample.per_type is None else [f"{sample.per_type} of each type"]
    told += [f"cells `{', '.join(sample.cells)}`"] if sample.cells else []
    return ", ".join(told)
