"""Claims: statements that one arm is above or below another, and what the paired rows say about them.

A claim is judged by the differences of its arms on the scenarios that both drove, matched by training. The p-value is
two-sided, see `crossed_bootstrap.p_value`; all claims of a list are corrected together (Holm 1979). The chance
of any false verdict in the list is then about 5 % over scenarios; with three trainings it is 2 to 22 %, by how much
these differ, see there. A list of twenty claims without correction has a false one in two of three studies.

A claim about trained arms with fewer than three trainings is not resolved, as scenarios of one training say nothing
about other seeds. It counts in the correction with a p-value of 1, so that it makes no other claim easier. Arms without
training, such as rules, experts and planners, need none. Nor can any data resolve a claim of fewer than six scenarios:
of the signs of five, 2 of 32 are as far. It counts in the correction, too: no list is changed after a look at results.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal

from dohyo.agents.studies.crossed_bootstrap import Matched, by_training, difference, estimate, p_value
from dohyo.agents.studies.rows import Row, is_lost, matched
from dohyo.evaluation.significance import FEWEST
from dohyo.evaluation.statistics import Estimate

LEVEL: Final = 0.05
ENOUGH_TRAININGS: Final = 3
Relation = Literal[">", "<", "="]
Verdict = Literal["reproduced", "not resolved", "contradicted"]


@dataclass(frozen=True, slots=True)
class Claim:
    """Arm against arm on one measure.

    Attributes:
        left: Arm whose value is claimed to be higher (">"), lower ("<") or equal ("=").
        relation: The relation.
        right: Other arm.
        measure: Measure of the rows.
        where: Benchmark, task or data set; empty for all rows.
        told: Wording in tables; empty: the names of the arms.
        ablation: Number of the theses' comparison that it decides, see `ablations`; 0: it is ours.
    """

    left: str
    relation: Relation
    right: str
    measure: str
    where: str = ""
    told: str = ""
    ablation: int = 0

    def __str__(self) -> str:
        """Wording in tables."""
        return self.told or f"{self.left} {self.relation} {self.right}"


def of_ablation(number: int, *claims: Claim) -> tuple[Claim, ...]:
    """Claims that decide a comparison of the theses, see `Claim.ablation`."""
    return tuple(replace(claim, ablation=number) for claim in claims)


def above(left: str, *others: str, measure: str, where: str = "") -> tuple[Claim, ...]:
    """Claims that an arm is above each of some others."""
    return tuple(Claim(left, ">", other, measure, where) for other in others)


@dataclass(frozen=True, slots=True)
class Judgement:
    """Result of a claim.

    Attributes:
        claim: The claim.
        difference: Mean of left - right with its 95 % interval, which is not corrected.
        trainings: Mean difference of each training, by seed.
        p: Two-sided p-value; 1 with too few trainings.
        adjusted: The same after Holm's correction over the list.
        verdict: Of the corrected p-value.
        scenarios: Number of scenarios that both arms drove.
    """

    claim: Claim
    difference: Estimate
    trainings: Mapping[int | None, float]
    p: float
    adjusted: float
    verdict: Verdict
    scenarios: int

    @property
    def few_trainings(self) -> bool:
        """Whether the arms have too few trainings for a verdict."""
        return _has_few(self.trainings)

    @property
    def too_few(self) -> str:
        """What no data of so many could resolve, such as "2 trainings" or "4 scenarios"; empty: they are enough."""
        if self.few_trainings:
            return _counted(len(self.trainings), "training")
        # A single scenario, such as a return of the training itself, is judged over trainings.
        needed = FEWEST if self.scenarios > 1 or len(self.trainings) == 1 else 1
        return _counted(self.scenarios, "scenario") if self.scenarios < needed else ""


def judge_rows(
    claims: Iterable[Claim],
    rows: Iterable[Row],
    *,
    at: Callable[[Row, str], bool] = lambda row, where: where in ("", row["benchmark"]),
    values: Callable[[Iterable[Row], str, str], Matched] = matched,
    interval: Callable[[Matched], Estimate] = estimate,
) -> list[Judgement]:
    """Judges a list of claims by the rows of their places; see `judge`.

    Args:
        claims: All claims of the study.
        rows: All rows.
        at: Whether a row belongs to the place of a claim, see `Claim.where`.
        values: Values of a measure in an arm, see `matched`.
        interval: See `judge`.
    """
    kept = [row for row in rows if not is_lost(row)]
    return judge(
        claims,
        lambda claim, arm: values((row for row in kept if at(row, claim.where)), arm, claim.measure),
        interval,
    )


def judge(
    claims: Iterable[Claim],
    values: Callable[[Claim, str], Matched],
    interval: Callable[[Matched], Estimate] = estimate,
) -> list[Judgement]:
    """Judges a list of claims; those whose arms have no scenario in common are left out.

    Args:
        claims: All claims of the study; they are corrected together.
        values: Values of an arm for a claim.
        interval: Mean and interval of paired differences.
    """
    pairs = [(claim, difference(values(claim, claim.left), values(claim, claim.right))) for claim in claims]
    pairs = [(claim, differences) for claim, differences in pairs if differences]
    means = [by_training(differences) for _, differences in pairs]
    p_values = [1.0 if _has_few(of) else p_value(some) for of, (_, some) in zip(means, pairs, strict=True)]
    judged = []
    for (claim, differences), of, p, adjusted in zip(pairs, means, p_values, holm(p_values), strict=True):
        found = interval(differences)
        said = verdict(claim.relation, found.mean or 0.0, adjusted)
        judged.append(Judgement(claim, found, of, p, adjusted, said, len(differences)))
    return judged


def _has_few(trainings: Mapping[int | None, float]) -> bool:
    """Whether something was trained, but too few times; values without a training have the seed None."""
    return 0 < len(trainings.keys() - {None}) < ENOUGH_TRAININGS


def _counted(count: int, what: str) -> str:
    return f"{count} {what}{'s' * (count != 1)}"


def verdict(relation: Relation, mean: float, adjusted: float) -> Verdict:
    """Verdict on a claim.

    A difference contradicts the claim of none; no significant difference does not prove that claim.

    Args:
        relation: Claimed.
        mean: Mean difference.
        adjusted: Corrected p-value.
    """
    if adjusted >= LEVEL or mean == 0.0:
        return "not resolved"
    return "reproduced" if relation == (">" if mean > 0.0 else "<") else "contradicted"


def holm(p_values: Sequence[float]) -> list[float]:
    """Adjusted p-values, in the given order: the smallest times n, the next times n - 1, ..., never decreasing.

    Source: Holm 1979.
    """
    adjusted, largest = [1.0] * len(p_values), 0.0
    for rank, place in enumerate(sorted(range(len(p_values)), key=p_values.__getitem__)):
        largest = max(largest, min(1.0, (len(p_values) - rank) * p_values[place]))
        adjusted[place] = largest
    return adjusted
