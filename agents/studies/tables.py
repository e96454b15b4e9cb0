"""Tables of studies as Markdown, and RESULTS.md, whose sections are written from stored rows, each between its marks.

<!-- begin val14 -->
| arm | score |
<!-- end val14 -->
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Final, TypeVar

from dohyo.agents.studies.claims import LEVEL, Judgement
from dohyo.agents.studies.crossed_bootstrap import estimate
from dohyo.agents.studies.rows import Row, matched
from dohyo.evaluation.report.style import MISSING, interval, markdown, number
from dohyo.evaluation.statistics import Estimate, mean_estimate
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.files import write_atomically

R = TypeVar("R")
ClaimColumns = Mapping[str, Callable[[Judgement], str]]
"""Cells of a claim, by head."""
PAGE: Final = "RESULTS.md"


def each_training(one: Judgement) -> str:
    """Mean difference of each training."""
    return ", ".join(f"{mean:+.0f}" for mean in one.trainings.values())


COLUMNS: Final[ClaimColumns] = MappingProxyType(
    {
        "claim": lambda one: str(one.claim),
        **dict.fromkeys(("where", "on", "benchmark", "policy"), lambda one: one.claim.where),
        "measure": lambda one: one.claim.measure,
        "n": lambda one: str(one.difference.n),
        "each training": each_training,
    }
)


def rounded(one: Judgement) -> str:
    """Difference with its interval, to one decimal."""
    return fixed(one.difference)


def claims_section(
    judged: Callable[[R], Sequence[Judgement]],
    heads: Sequence[str] = ("claim", "where", "measure"),
    shown: Callable[[Judgement], str] = lambda one: interval(one.difference),
    more: ClaimColumns = MappingProxyType({}),
) -> Callable[[R], str]:
    """Section with the verdicts on a study's claims, see `claims_table`."""
    return lambda results: claims_table(judged(results), heads, shown, more)


def claims_table(
    judged: Sequence[Judgement],
    heads: Sequence[str],
    shown: Callable[[Judgement], str] = lambda one: interval(one.difference),
    more: ClaimColumns = MappingProxyType({}),
) -> str:
    """A row per claim; empty without any.

    Args:
        judged: Claims of one list.
        heads: Of the columns before the difference, in `COLUMNS` or `more`.
        shown: Difference with its interval.
        more: Other columns.
    """
    cells = [{**COLUMNS, **more}[head] for head in heads]
    rows = [[*(cell(one) for cell in cells), shown(one), *_verdict_cells(one)] for one in judged]
    return markdown([*heads, "paired difference", "p (Holm)", "verdict"], rows) if rows else ""


def _verdict_cells(one: Judgement) -> tuple[str, str]:
    """Corrected p-value and verdict; with too few trainings or scenarios, their number in place of a test."""
    if one.too_few:
        return MISSING, f"{one.verdict}: {one.too_few}"
    return probability(one.adjusted), one.verdict


def mean_of(
    rows: Iterable[Row],
    arm: str,
    measure: str,
    digits: int = 1,
    alone: Callable[[Sequence[float]], Estimate] = mean_estimate,
) -> str:
    """Mean of a measure over scenarios and trainings of an arm, with its interval; "—" without values.

    Args:
        rows: Among others those of the arm.
        arm: Its name.
        measure: Of the rows.
        digits: Decimals.
        alone: Estimate of independent values, see `estimate`.
    """
    values = matched(rows, arm, measure)
    return fixed(estimate(values, alone), digits) if values else MISSING


def probability(p: float) -> str:
    """A p-value to two digits; to one more where it is below the level and would be rounded to it."""
    if 0.0495 <= p < LEVEL:
        return f"{min(p, 0.0499):.4f}"
    return "< 0.001" if p < 0.001 else f"{p:.3f}" if p < 0.1 else f"{p:.2f}"


def fixed(estimate: Estimate, digits: int = 1) -> str:
    """Mean with its interval, to a fixed number of decimals."""
    if estimate.mean is None:
        return ""
    if estimate.low is None or estimate.high is None:
        return f"{estimate.mean:.{digits}f}"
    return f"{estimate.mean:.{digits}f} [{estimate.low:.{digits}f}, {estimate.high:.{digits}f}]"


def bracketed(estimate: Estimate) -> str:
    """Mean with its interval, to three significant digits."""
    if estimate.mean is None:
        return "-"
    if estimate.low is None or estimate.high is None:
        return number(estimate.mean)
    return f"{number(estimate.mean)} [{number(estimate.low)}, {number(estimate.high)}]"


def anchor(heading: str) -> str:
    """Fragment of a heading's address, as GitHub and MyST make it."""
    kept = (letter for letter in heading.lower() if letter.isalnum() or letter in " -")
    return "".join(kept).replace(" ", "-")


def write_section(page: Path, section: str, text: str) -> None:
    """Replaces what stands between the marks of one section.

    Raises:
        InvalidInputError: The page does not have the two marks.
    """
    begin, end = f"<!-- begin {section} -->", f"<!-- end {section} -->"
    before, found_begin, rest = page.read_text().partition(begin)
    _, found_end, after = rest.partition(end)
    if not (found_begin and found_end):
        raise InvalidInputError(f"'{page}': expected the marks {begin} and {end}")
    write_atomically(page, f"{before}{begin}\n{text.strip()}\n{end}{after}".encode())
