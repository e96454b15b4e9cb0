"""Tables of GHRL's drives: success by cell and arm, failures, work of the rules, and claims.

Intervals are those of `crossed_bootstrap`; for one training, or equal outcomes of all drives, Wilson's.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, Final

from dohyo.agents.studies.claims import Claim, Judgement, judge_rows
from dohyo.agents.studies.crossed_bootstrap import Matched, by_training, common, difference, estimate, of_shares
from dohyo.agents.studies.rows import Row, by_arm, by_place, grouped, is_lost, matched
from dohyo.agents.studies.study import Results
from dohyo.agents.studies.tables import COLUMNS, claims_table
from dohyo.evaluation.records.specifications import COLLISIONS, InfractionKind, Status
from dohyo.evaluation.report.style import MISSING, ending, interval, markdown, number

PAIRS: Final = (
    ("ghrl", "hrl"), ("ghrl-r", "ghrl"), ("ghrl-r", "hrl"), ("ghrl", "flat-guided"), ("ghrl", "ghrl-pictures"),
    ("ghrl-r-pictures", "ghrl-pictures"), ("ghrl-s", "ghrl-r"), ("ghrl-r", "rules"),
)  # fmt: skip
"""Claims: the first arm succeeds more often; the first three are the thesis's."""
UNLAWFUL: Final = {"red_light", "stop_sign"}


def arms_section(*arms: str) -> Callable[[Results], str]:
    """Section with all four tables of some arms, in the order of the columns; those without drives are left out."""

    def section(results: Results) -> str:
        return tables(rows_of(results, arms), arms)

    return section


def rows_of(results: Results, arms: Sequence[str]) -> list[Row]:
    """Rows of some arms, of the benchmarks' own seed."""
    return [row for row in results.rows if row["arm"] in arms and row["seed"] == 0]


def unseen_section(results: Results) -> str:
    """Success in traffic that was not looked at: the scenarios of another seed."""
    rows = [row for row in results.rows if row["seed"] != 0]
    arms = [*grouped(rows, "arm")]
    return f"{success_table(rows, arms)}\n\n{failure_table(rows, arms)}" if rows else ""


def lines_section(left: str, right: str) -> Callable[[Results], str]:
    """Success of two arms that differ by a setting alone, and the paired differences; "" without both."""

    def section(results: Results) -> str:
        rows = rows_of(results, (left, right))
        if len({row["arm"] for row in rows}) < 2:
            return ""
        benchmarks = grouped(rows, "benchmark")

        def differences(measure: str) -> list[str]:
            return [interval(estimate(_apart(some, left, right, measure))) for some in benchmarks.values()]

        told = {"success": "NoCrash success", "lawful": "lawful success"}
        lines = [[f"{name}, {left} less {right}", *differences(measure)] for measure, name in told.items()]
        heads = ["paired difference, points", *benchmarks]
        parts = (success_table(rows, (left, right)), failure_table(rows, (left, right)), markdown(heads, lines))
        return "\n\n".join(parts)

    return section


def _apart(rows: Sequence[Row], left: str, right: str, measure: str) -> Matched:
    return difference(percent(rows, left, measure), percent(rows, right, measure))


def tables(rows: Sequence[Row], arms: Sequence[str]) -> str:
    """All four tables as Markdown."""
    there = [*by_arm(rows, arms)]
    parts = (success_table(rows, there), failure_table(rows, there), rules_table(rows, there), claim_table(rows))
    return "\n\n".join(part for part in parts if part)


def success_table(rows: Sequence[Row], arms: Sequence[str]) -> str:
    """A row per cell, or per kind of event, and two per benchmark; each training in parentheses.

    A row is over the scenarios that all trainings of an arm drove; a row of all cells over those that all of its arms
    drove, too. A training that drove more has a row of its own below. Beside a benchmark's success stands its lawful
    success, of drives that ran no red light or stop sign. The last row is the thesis's success of long drives, 2500 m
    without a collision, if routes are so long.
    """
    lines: list[tuple[str, Sequence[Row], str, bool]] = []
    for benchmark, some in grouped(rows, "benchmark").items():
        groups = dict.fromkeys(map(_group, some))
        lines += [
            (f"{benchmark}: {one}", [row for row in some if _group(row) == one], "success", False) for one in groups
        ]
        if len(groups) > 1:
            lines.append((f"{benchmark}, all", some, "success", True))
        if any("red_light" in row["infractions"] for row in _kept(some)):
            lines.append((f"{benchmark}, all, no red light or stop sign run either", some, "lawful", True))
    if len(grouped(rows, "benchmark")) > 1:
        lines.append(("all", rows, "success", True))
    if long := [row for row in rows if row.get("drove_2500m") is not None]:
        lines.append(("2500 m before any collision", long, "drove_2500m", True))
    cells = [row for name, some, measure, pooled in lines for row in _success_rows(name, some, arms, measure, pooled)]
    return markdown(["NoCrash success, %", *arms], cells)


def _success_rows(
    name: str, rows: Sequence[Row], arms: Sequence[str], measure: str, pooled: bool
) -> Iterator[Sequence[str]]:
    """Row of what all trainings drove, and one of each training that drove more; without a mean it is left out."""
    found = {arm: percent(rows, arm, measure) for arm in arms}
    even = {arm: common(values) for arm, values in found.items()}
    if pooled:
        shared = frozenset[tuple[Any, ...]].intersection(*(frozenset(some) for some in even.values() if some))
        even = {arm: {key: row for key, row in some.items() if key in shared} for arm, some in even.items()}
    if any(even.values()):
        yield [name, *(_success(even[arm], pooled) for arm in arms)]
    whole: dict[int | None, dict[str, Matched]] = {}
    for arm, values in found.items():
        counts = Counter(seed for row in values.values() for seed in row)
        for seed, count in counts.items():
            if count > len(common(values)):
                whole.setdefault(seed, {})[arm] = {key: {seed: row[seed]} for key, row in values.items() if seed in row}
    for seed, own in whole.items():
        yield [f"{name}: all drives of training {seed}", *(_success(own.get(arm, {}), pooled) for arm in arms)]


def failure_table(rows: Sequence[Row], arms: Sequence[str]) -> str:
    """A row per benchmark and arm: how drives failed, red lights run, and lawful successes."""
    lines = []
    for benchmark, arm, some in by_place(rows, arms):
        kept = _kept(some)
        told = ", ".join(f"{count} {kind}" for kind, count in failures(some).most_common()) or "none"
        red = sum(row["infractions"].count("red_light") for row in kept)
        lawful = _counted(sum(map(is_lawful, kept)), len(kept))
        lost = str(len(some) - len(kept))
        lines.append([benchmark, arm, str(len(kept)), told, str(red), lawful, lost])
    heads = ["benchmark", "arm", "drives", "failures", "red lights run", "lawful success, %", "lost, not counted"]
    return markdown(heads, lines)


def rules_table(rows: Sequence[Row], arms: Sequence[str]) -> str:
    """A row per benchmark and arm that RSS monitored; empty without any."""
    lines = []
    for benchmark, arm, some in by_place(rows, arms):
        watched = [row for row in _kept(some) if "critical_share" in row]
        if seconds := math.fsum(row["duration_s"] for row in watched):
            critical = math.fsum(row["critical_share"] * row["duration_s"] for row in watched)
            longest = max(row["longest_standing_s"] for row in watched)
            told = [row["deadlock"] for row in watched if "deadlock" in row]
            deadlocks = f"{sum(told)} of {len(told)}" if told else MISSING
            lines.append([benchmark, arm, f"{100 * critical / seconds:.1f}", number(longest), deadlocks])
    heads = ["benchmark", "arm", "time in critical intervals, %", "longest stand within one, s", "deadlocks, drives"]
    return markdown(heads, lines) if lines else ""


def judged(rows: Sequence[Row]) -> list[Judgement]:
    """Each claim, over all benchmarks and for each."""
    benchmarks = [*grouped(rows, "benchmark")]
    wheres = ["", *benchmarks] if len(benchmarks) > 1 else benchmarks
    claims = [
        Claim(left, ">", right, "success", where, ablation=26 if (left, right) in PAIRS[:3] else 0)
        for left, right in PAIRS
        for where in wheres
    ]
    return judge_rows(claims, rows, values=percent)


def claim_table(rows: Sequence[Row]) -> str:
    """A row per claim; empty without any."""
    claim = "claim: more successes, points"
    more = {claim: COLUMNS["claim"], "benchmark": lambda one: one.claim.where or "all"}
    return claims_table(judged(rows), (claim, "benchmark", "each training"), more=more)


def percent(rows: Iterable[Row], arm: str, measure: str) -> Matched:
    """0 or 100 of every drive of an arm that was not lost."""
    outcomes = ({**row, "lawful": is_lawful(row)} if not is_lost(row) else row for row in rows)
    return {
        key: {seed: 100.0 * value for seed, value in of.items()} for key, of in matched(outcomes, arm, measure).items()
    }


def is_lawful(row: Row) -> bool:
    """Whether a drive succeeded and ran neither a red light nor a stop sign."""
    return bool(row["success"]) and UNLAWFUL.isdisjoint(row["infractions"])


def failures(rows: Iterable[Row]) -> Counter[str]:
    """Failures by the first collision, or by the ending; lost drives do not count."""
    found: Counter[str] = Counter()
    for row in _kept(rows):
        if not row["success"]:
            hits = [kind for kind in map(InfractionKind, row["infractions"]) if kind in COLLISIONS]
            found[hits[0].specification.label if hits else ending(Status(row["status"]))] += 1
    return found


def _success(values: Matched, each: bool) -> str:
    if not values:
        return MISSING
    trainings = by_training(values)
    told = f" ({', '.join(f'{mean:.0f}' for mean in trainings.values())})" if each and len(trainings) > 1 else ""
    return interval(estimate(values, of_shares)) + told


def _counted(count: int, total: int) -> str:
    return f"{number(100 * count / total)} ({count})" if total else MISSING


def _group(row: Row) -> str:
    cell: str = row["cell"]
    return cell.partition(".")[0] if row.get("event") else cell


def _kept(rows: Iterable[Row]) -> list[Row]:
    return [row for row in rows if not is_lost(row)]
