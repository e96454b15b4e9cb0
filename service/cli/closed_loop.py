"""Tables of the closed-loop score for the command line."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from dohyo.evaluation.scores.nuplan.summary import TERMS, ClosedLoopSummary, ScoredDrive
from dohyo.service.cli.output import console, interval, number, print_rows

SHORT = dict(zip(TERMS, ("NC", "DAC", "DDC", "MP", "TTC", "SL", "EP", "C"), strict=True))


def print_closed_loop(summaries: Mapping[str, ClosedLoopSummary], what: str) -> None:
    """Prints one row per agent or type: score, CR, DA and EP with intervals, then the means of all terms."""
    columns = [what, "score", "CR %", "DA %", "EP %", *SHORT.values(), "red", "n"]
    rows = []
    for name, one in summaries.items():
        terms = [one.terms[term].mean for term in TERMS]
        rows.append(
            (
                name,
                *map(interval, (one.score, one.collisions, one.off_road, one.progress)),
                *("" if value is None else number(value) for value in terms),
                str(one.red_lights),
                str(one.drives),
            )
        )
    print_rows(columns, rows)
    for name, one in summaries.items():
        if one.score_lost_as_zero is not None:
            console.print(
                f"{name}: {one.lost} drives lost to gridlocks or infrastructure faults; score counting lost drives as "
                f"0: {interval(one.score_lost_as_zero)}",
            )


def print_legend() -> None:
    """Prints the meaning of the columns."""
    console.print(
        "score = NC x DAC x DDC x MP x (5 EP + 5 TTC + 4 SL + 2 C) / 16; CR = 100 - NC, DA = 100 - DAC; "
        "red lights in no term; 95 % intervals"
    )


def print_terms(drives: Sequence[ScoredDrive]) -> None:
    """Prints one row per drive, with every term."""
    rows = [
        (
            f"{one.scenario}-s{one.seed}",
            one.ego,
            number(one.terms.score),
            *(number(100.0 * getattr(one.terms, term)) for term in TERMS),
            str(one.terms.red_lights),
        )
        for one in drives
    ]
    print_rows(["record", "ego", "score", *(f"{short} %" for short in SHORT.values()), "red"], rows)
