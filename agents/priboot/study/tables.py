"""Tables of the study of PRIBOOT as Markdown: arms, claims, infractions per km, and scores by the route's length."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from operator import itemgetter
from typing import Final

import numpy as np

from dohyo.agents.priboot.study.arms import ARMS
from dohyo.agents.studies.claims import Claim, Judgement, Relation, judge_rows
from dohyo.agents.studies.rows import Row, by_place, grouped, infractions_per_km
from dohyo.agents.studies.study import Results
from dohyo.agents.studies.tables import claims_section, mean_of, rounded
from dohyo.evaluation.records.specifications import InfractionKind
from dohyo.evaluation.report.style import MISSING, markdown
from dohyo.sumo_networks.arrays import FloatArray

MEASURES: Final[Mapping[str, str]] = {
    "driving_score": "DS, %",
    "irs": "IRS, L driven, %",
    "irs_route": "IRS, L route, %",
    "route_completion": "RC, %",
    "infraction_penalty": "IP",
    "nocrash_success": "NoCrash success, %",
}
LOSSES: Final[Mapping[str, str]] = {"validation_loss": "loss", "displaced_loss": "loss, displaced"}
STARTS: Final[Mapping[str, str]] = {"starts": "starts, %", "false_starts": "false starts, %"}
"""Shares of the standing moments of held-out drives at which the network starts, of those where the expert does and of
the others."""
CLAIMS: Final = tuple(
    Claim("full", ">", arm, measure, where, ablation=19)
    for where in ("nocrash", "leaderboard")
    for arm, measure in (
        ("no-augmentation", "route_completion"),
        ("no-augmentation", "driving_score"),
        ("masks", "route_completion"),
        ("no-rules", "driving_score"),
        ("data-10", "driving_score"),
    )
)
PAIRED: Final = ("autopilot", "full", "no-rules")
"""Arms whose drives are also joined in pairs, to judge what a longer route does to a score."""
_LENGTHENED: Final[Mapping[str, Relation]] = {"driving_score": "<", "irs": "="}
LENGTH_CLAIMS: Final = tuple(
    Claim(f"{arm} x 2", relation, f"{arm} x 1", measure, where, ablation=20)
    for where, arms in (("nocrash", PAIRED), ("leaderboard", ("full",)))
    for arm in arms
    for measure, relation in _LENGTHENED.items()
)
SCORES: Final = (("IP", 2), ("DS, %", 1), ("IRS, L driven, %", 1), ("IRS, L route, %", 1))
"""Of `joined`, with their decimals."""
JOINED: Final = (1, 2, 4, 8, 16)
"""Number of drives that are joined to one route."""
ROUTES, SEED, LAMBDA = 400, 0, 4.0


def judged(results: Results) -> list[Judgement]:
    """All claims on the drives, and on the same drives joined in pairs."""
    rows = results.kept
    return judge_rows((*CLAIMS, *LENGTH_CLAIMS), (*rows, *in_pairs(rows)))


claims = claims_section(
    judged, ("claim", "benchmark", "measure", "n"), rounded, {"measure": lambda one: MEASURES[one.claim.measure]}
)


def in_pairs(rows: Sequence[Row]) -> list[Row]:
    """Rows of two drives each, neighbours in the order of their names: as two routes (x 1) and joined (x 2).

    A drive without a partner is left out.
    """
    found = list[Row]()
    for network, arm, own in by_place(rows, PAIRED):
        for training, some in grouped(own, "training_seed").items():
            drives = sorted(some, key=itemgetter("scenario", "seed"))
            for one, other in zip(drives[::2], drives[1::2], strict=False):
                cell = {"training_seed": training, "benchmark": network, "seed": one["seed"]}
                cell["scenario"] = f"{one['scenario']}, {other['scenario']}"
                alone = [_scores(_parts(one)), _scores(_parts(other))]
                both = _scores(np.add(_parts(one), _parts(other)))
                for times, scores in ((1, np.mean(alone, axis=0)), (2, both)):
                    measures = dict(zip(_LENGTHENED, scores.tolist(), strict=True))
                    found.append({**cell, "arm": f"{arm} x {times}", **measures})
    return found


def _scores(parts: Sequence[float] | FloatArray) -> FloatArray:
    """Driving score and infraction rate score of what `_parts` has, %."""
    done, route, driven, log_penalty, weight = parts
    completion = 100.0 * done / route
    rate = math.exp(-LAMBDA * weight * 1000.0 / max(driven, 1.0))
    return np.array([completion * math.exp(log_penalty), completion * rate])


def arms_table(results: Results) -> str:
    """A row per arm and network."""
    lines = []
    for network, arm, own in by_place(results.kept, ARMS):
        scores = [mean_of(own, arm, name, 2 if name == "infraction_penalty" else 1) for name in MEASURES]
        thesis = ARMS[arm].reported
        told = MISSING if thesis is None else " / ".join(f"{value:g}" for value in thesis)
        lines.append([network, arm, ARMS[arm].isolates or MISSING, *scores, *_losses(own), str(len(own)), told])
    heads = ["benchmark", "arm", "difference", *MEASURES.values(), *LOSSES.values(), *STARTS.values(), "drives"]
    return markdown([*heads, "thesis: DS / IRS / RC"], lines) if lines else ""


def infractions_table(results: Results) -> str:
    """Infractions per km driven, and the mean speed, pooled over the drives of an arm."""
    lines, rows = [], results.kept
    seen = [kind.value for kind in InfractionKind if any(kind.value in row["infractions"] for row in rows)]
    for network, arm, own in by_place(rows, ARMS):
        km, rates = infractions_per_km(own)
        endings = Counter(row["status"] for row in own)
        told = ", ".join(f"{count} {status.removeprefix('failed: ')}" for status, count in endings.most_common())
        speed = 1000.0 * km / max(math.fsum(row["duration_s"] for row in own), 0.1)
        lines.append([network, arm, f"{km:.1f}", f"{speed:.1f}", *(f"{rates[kind]:.2f}" for kind in seen), told])
    return markdown(["benchmark", "arm", "km", "mean speed, m/s", *seen, "endings"], lines) if lines else ""


def lengths_table(results: Results) -> str:
    """Scores of routes that are drives of one arm joined end to end: the same driving, more of it."""
    lines = []
    for network, arm, own in by_place(results.kept, ARMS):
        scores = {count: joined(own, count) for count in JOINED}
        for which, (head, digits) in enumerate(SCORES):
            lines.append([network, arm, head, *(f"{scores[count][which]:.{digits}f}" for count in JOINED)])
    return markdown(["benchmark", "arm", "score", *(f"x {count}" for count in JOINED)], lines) if lines else ""


def joined(rows: Sequence[Row], count: int) -> tuple[float, float, float, float]:
    """Mean penalty, driving score, and infraction rate scores over 400 routes, each of some drives drawn at random.

    Lengths and infractions add up, and the completion is that of all lengths. A drive that ended early counts as if the
    next one had gone on, so that only the length differs between the columns. The share of a drive outside its lanes
    enters as an infraction.
    """
    rng = np.random.default_rng(SEED)
    table = np.array([_parts(row) for row in rows])
    sums = table[rng.integers(len(table), size=(ROUTES, count))].sum(axis=1)
    done, route, driven, log_penalty, weight = sums.T
    completion, penalty = 100.0 * done / route, np.exp(log_penalty)
    scores = [completion * np.exp(-LAMBDA * weight * 1000.0 / np.maximum(length, 1.0)) for length in (driven, route)]
    means = [penalty.mean(), (completion * penalty).mean(), *(score.mean() for score in scores)]
    return means[0], means[1], means[2], means[3]


def _parts(row: Row) -> tuple[float, float, float, float, float]:
    """Metres completed, of the route and driven; logarithm of the penalty; sum of 1 - p over the infractions.

    The weight is taken back from the stored score, so that magnitudes of infractions are in it.
    """
    done = row["route_completion"] / 100.0 * row["route_m"]
    outside = row["irs"] / max(row["route_completion"], 1e-9)
    weight = -math.log(max(outside, 1e-300)) * max(row["driven_m"], 1.0) / 1000.0 / LAMBDA
    return done, row["route_m"], row["driven_m"], math.log(max(row["infraction_penalty"], 1e-300)), weight


def _losses(rows: Sequence[Row]) -> list[str]:
    """Mean measures of the trainings on held-out drives."""
    trainings = {row["training_seed"]: row for row in rows if row["training_seed"] is not None}.values()
    found = {name: [row[name] for row in trainings if name in row] for name in (*LOSSES, *STARTS)}
    scale = {name: 100.0 if name in STARTS else 1.0 for name in found}
    return [
        f"{scale[name] * np.mean(values):.{0 if name in STARTS else 2}f}" if values else MISSING
        for name, values in found.items()
    ]
