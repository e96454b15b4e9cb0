"""Tables of the study of plans: every arm, and the changes that it makes to another on the same mornings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

from dohyo.agents.speed_planning.study.dissipation import DESIGNS
from dohyo.agents.speed_planning.study.mornings import ARMS, BENCHMARK, CHOSEN, FLEETS, FURTHER, PLANS
from dohyo.agents.studies.claims import Claim, Judgement, Relation
from dohyo.agents.studies.rows import Row, by_arm, matched
from dohyo.agents.studies.study import Results, judging
from dohyo.agents.studies.tables import mean_of
from dohyo.evaluation.report.style import markdown

SHOWN: Final = {
    "throughput_vph": ("throughput, veh/h", 0),
    "speed_mps": ("speed, m/s", 2),
    "speed_std_mps": ("its deviation, m/s", 2),
    "speed_std_within_mps": ("within a minute, m/s", 2),
    "fuel_circles_g_km": ("fuel CIRCLES, g/km", 1),
    "fuel_sumo_g_km": ("fuel SUMO, g/km", 1),
    "least_headway_s": ("least headway, s", 2),
    "least_ttc_s": ("least TTC, s", 2),
    "collisions": ("collisions", 1),
    "waiting": ("waiting outside at the end", 0),
}
"""Metrics of the tables: head and decimals."""
COMPARED: Final[Mapping[str, Relation]] = {
    "throughput_vph": ">", "speed_std_mps": "<", "speed_std_within_mps": "<", "fuel_circles_g_km": "<",
}  # fmt: skip
"""Metrics of the claims, and what a better arm has."""
Pairs = Sequence[tuple[str, str]]
BETTER_FORECAST: Final[Pairs] = tuple(
    (f"{design}+{forecast}", f"{design}+persistence")
    for design in DESIGNS[1:]
    for forecast in ("sa-lstm", "oracle", "none")
)
TITLES: Final[Mapping[str, str]] = {FURTHER: "Further mornings", BENCHMARK: "Mornings of all arms"}
PAIRS: Final[Mapping[str, Mapping[str, Pairs]]] = {
    FURTHER: {"One against the other": (*((arm, "none") for arm in CHOSEN), CHOSEN[::-1])},
    BENCHMARK: {
        "Against `none`": tuple((arm.name, "none") for arm in PLANS),
        "Another forecast against persistence": BETTER_FORECAST,
        "Other shares of connected cars, against `none`": tuple((arm.name, "none") for arm in FLEETS),
    },
}
"""Arms that are compared, by benchmark and head of the table."""
CLAIMS: Final = [
    Claim(arm, relation, other, metric, where=where, ablation=13)
    for where, tables_of in PAIRS.items()
    for pairs in tables_of.values()
    for arm, other in pairs
    for metric, relation in COMPARED.items()
]
judged = judging(CLAIMS)


def tables(results: Results) -> str:
    """Means and differences: of the chosen designs on further mornings, and of all arms on ten."""
    parts, verdicts = [], judged(results)
    for where, title in TITLES.items():
        if rows := [row for row in results.kept if row["benchmark"] == where]:
            claims = [(one.claim, one) for one in verdicts if one.claim.where == where]
            found = {(claim.left, claim.right, claim.measure): one for claim, one in claims}
            parts.append(f"### {title}\n\n{_means(rows)}")
            for head, pairs in PAIRS[where].items():
                if table := _differences(rows, found, pairs):
                    parts.append(f"{head}, same seeds, %:\n\n{table}")
    return "\n\n".join(parts)


def _means(rows: Sequence[Row]) -> str:
    """Means of every arm with their intervals."""
    means = [
        [arm, str(len(own)), *(mean_of(own, arm, metric, digits) for metric, (_, digits) in SHOWN.items())]
        for arm, own in by_arm(rows, ARMS).items()
    ]
    return markdown(["arm", "n", *(head for head, _ in SHOWN.values())], means)


def _differences(rows: Sequence[Row], found: Mapping[tuple[str, str, str], Judgement], pairs: Pairs) -> str:
    """A row per pair of arms that both have rows; "" without any."""
    lines = []
    for arm, other in pairs:
        verdicts = [found.get((arm, other, metric)) for metric in COMPARED]
        cells = [_percent(rows, one) for one in verdicts if one is not None]
        if cells and verdicts[0] is not None:
            lines.append([arm, other, str(verdicts[0].difference.n), *cells])
    heads = ["arm", "against", "n", *(SHOWN[metric][0].partition(",")[0] for metric in COMPARED)]
    return markdown(heads, lines) if lines else ""


def _percent(rows: Sequence[Row], one: Judgement) -> str:
    """A difference as a share of the other arm's mean on the same seeds, %, with its interval and side."""
    mine, other = (matched(rows, arm, one.claim.measure) for arm in (one.claim.left, one.claim.right))
    base = [value for key, by in other.items() if key in mine for value in by.values()]
    scale, difference = 100.0 * len(base) / sum(base), one.difference
    if difference.mean is None or difference.low is None or difference.high is None:
        return ""
    mean, low, high = (scale * value for value in (difference.mean, difference.low, difference.high))
    side = "=" if one.verdict == "not resolved" else "<" if mean < 0.0 else ">"
    return f"{mean:+.1f} [{low:+.1f}, {high:+.1f}] {side}"
