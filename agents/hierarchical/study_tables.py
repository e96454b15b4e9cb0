"""Tables of a study: success by cell and arm, failures, work of the rules, and paired differences.

Intervals are those of `crossed`; for one training, or equal outcomes of all drives, Wilson's.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, Final

from dohyo.agents.studies.crossed_bootstrap import Matched, by_training, difference, estimate, of_pairs, verdict
from dohyo.evaluation.records.specifications import COLLISIONS, InfractionKind, Status
from dohyo.evaluation.report.style import MISSING, ending, interval, markdown, number
from dohyo.evaluation.statistics import Estimate, share_estimate
from dohyo.sumo_networks.files import read_lines

Drive = dict[str, Any]

PAIRS: Final = (
    ("ghrl", "hrl"), ("ghrl-r", "ghrl"), ("ghrl-r", "hrl"), ("hrl-r", "hrl"), ("ghrl-r", "hrl-r"), ("hrl", "flat"),
    ("ghrl", "flat-guided"), ("ghrl", "ghrl-pictures"), ("ghrl-r-pictures", "ghrl-pictures"),
    ("ghrl-r-trained", "ghrl-r"), ("ghrl-s", "ghrl-r"), ("ghrl-r", "rules"),
)  # fmt: skip
"""Compared arms."""


def read_drives(path: Path) -> list[Drive]:
    """Stored lines without a torn last one."""
    return [{"training_seed": None, "benchmark": path.stem, **line} for line in read_lines(path)]


def tables(drives: Sequence[Drive], arms: Iterable[str]) -> str:
    """All four tables as Markdown.

    Args:
        drives: Of any benchmarks.
        arms: In the order of the columns; those without drives are left out.
    """
    there = [arm for arm in arms if any(one["arm"] == arm for one in drives)]
    parts = (success_table(drives, there), failure_table(drives, there), rules_table(drives, there), pair_table(drives))
    return "\n\n".join(part for part in parts if part)


def success_table(drives: Sequence[Drive], arms: Sequence[str]) -> str:
    """A row per cell, or per kind of event, and one per benchmark; each training in parentheses.

    The last row is the thesis's success of long drives, 2500 m without a collision, if routes are so long.
    """
    rows: list[tuple[str, Sequence[Drive], bool]] = []
    for benchmark in _named(drives, "benchmark"):
        some = [one for one in drives if one["benchmark"] == benchmark]
        groups = dict.fromkeys(map(_group, some))
        rows += [(f"{benchmark}: {group}", [one for one in some if _group(one) == group], False) for group in groups]
        if len(groups) > 1:
            rows.append((f"{benchmark}, all", some, True))
    if len(_named(drives, "benchmark")) > 1:
        rows.append(("all", drives, True))
    long = [{**one, "success": one["drove_2500m"]} for one in drives if one.get("drove_2500m") is not None]
    if long:
        rows.append(("2500 m before any collision", long, True))
    cells = [
        [name, *(_success([one for one in some if one["arm"] == arm], each) for arm in arms)]
        for name, some, each in rows
    ]
    return markdown(["NoCrash success, %", *arms], cells)


def failure_table(drives: Sequence[Drive], arms: Sequence[str]) -> str:
    """A row per benchmark and arm: how drives failed, red lights run, and successes without a red light run."""
    rows = []
    for benchmark, arm, some in _by_arm(drives, arms):
        lost = len(some) - len(_kept(some))
        found = [f"{count} {kind}" for kind, count in failures(some).most_common()]
        red = sum(one["infractions"].count("red_light") for one in _kept(some))
        told = ", ".join(found) or "none"
        rows.append([benchmark, arm, str(len(_kept(some))), told, str(red), _lawful(_kept(some)), str(lost)])
    heads = ["benchmark", "arm", "drives", "failures", "red lights run", "lawful success, %", "lost, not counted"]
    return markdown(heads, rows)


def rules_table(drives: Sequence[Drive], arms: Sequence[str]) -> str:
    """A row per benchmark and arm that RSS monitored; empty without any."""
    rows = []
    for benchmark, arm, some in _by_arm(drives, arms):
        watched = [one for one in _kept(some) if "critical_share" in one]
        seconds = math.fsum(one["duration_s"] for one in watched)
        if seconds:
            critical = math.fsum(one["critical_share"] * one["duration_s"] for one in watched)
            longest = max(one["longest_standing_s"] for one in watched)
            told = [one["deadlock"] for one in watched if "deadlock" in one]
            deadlocks = f"{sum(told)} of {len(told)}" if told else MISSING
            rows.append([benchmark, arm, f"{100 * critical / seconds:.1f}", number(longest), deadlocks])
    heads = ["benchmark", "arm", "time in critical intervals, %", "longest stand within one, s", "deadlocks, drives"]
    return markdown(heads, rows) if rows else ""


def pair_table(drives: Sequence[Drive]) -> str:
    """A row per pair of `PAIRS`, over all benchmarks and for each, on the drives both made; empty without any."""
    names = _named(drives, "benchmark")
    wheres = {"all": drives} if len(names) > 1 else {}
    wheres |= {name: [one for one in drives if one["benchmark"] == name] for name in names}
    rows = []
    for above, below in PAIRS:
        for where, some in wheres.items():
            matched = differences(some, above, below)
            if matched:
                found = estimate(matched, of_pairs)
                each = ", ".join(f"{mean:+.0f}" for mean in by_training(matched).values())
                rows.append([f"{above} - {below}", where, interval(found), each, verdict(found)])
    heads = ["difference of successes, points", "benchmark", "mean", "each training", "significant"]
    return markdown(heads, rows) if rows else ""


def failures(drives: Iterable[Drive]) -> Counter[str]:
    """Failures by the first collision, or by the ending; lost drives do not count."""
    found: Counter[str] = Counter()
    for one in _kept(drives):
        if not one["success"]:
            hits = [kind for kind in map(InfractionKind, one["infractions"]) if kind in COLLISIONS]
            found[hits[0].specification.label if hits else ending(Status(one["status"]))] += 1
    return found


def successes(drives: Iterable[Drive]) -> Matched:
    """NoCrash success, 0 or 100, of every drive that was not lost."""
    found: dict[tuple[Any, ...], dict[int | None, float]] = {}
    for one in _kept(drives):
        key = one["benchmark"], one["scenario"], one["seed"]
        found.setdefault(key, {})[one["training_seed"]] = 100.0 * one["success"]
    return found


def differences(drives: Sequence[Drive], above: str, below: str) -> Matched:
    """One arm's successes minus another's, on common scenarios; see `crossed.difference`."""
    ours, theirs = (successes(one for one in drives if one["arm"] == arm) for arm in (above, below))
    return difference(ours, theirs)


def _of_successes(values: Sequence[float]) -> Estimate:
    return share_estimate([value > 0.0 for value in values])


def _success(drives: Sequence[Drive], each: bool) -> str:
    matched = successes(drives)
    if not matched:
        return MISSING
    trainings = by_training(matched)
    told = f" ({', '.join(f'{mean:.0f}' for mean in trainings.values())})" if each and len(trainings) > 1 else ""
    return interval(estimate(matched, _of_successes)) + told


def _lawful(drives: Sequence[Drive]) -> str:
    """Successes in which no red light was run: share and count."""
    count = sum(bool(one["success"]) and "red_light" not in one["infractions"] for one in drives)
    return f"{number(100 * count / len(drives))} ({count})" if drives else MISSING


def _by_arm(drives: Sequence[Drive], arms: Sequence[str]) -> Iterable[tuple[str, str, list[Drive]]]:
    for benchmark in _named(drives, "benchmark"):
        for arm in arms:
            some = [one for one in drives if (one["benchmark"], one["arm"]) == (benchmark, arm)]
            if some:
                yield benchmark, arm, some


def _group(one: Drive) -> str:
    cell: str = one["cell"]
    return cell.partition(".")[0] if one.get("event") else cell


def _kept(drives: Iterable[Drive]) -> list[Drive]:
    """Drives that the infrastructure did not lose; lost ones are in no mean."""
    return [one for one in drives if not one["status"].startswith("lost")]


def _named(drives: Iterable[Drive], field: str) -> list[str]:
    return list(dict.fromkeys(one[field] for one in drives))
