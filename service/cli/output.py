"""Output of the command line: tables for people, one JSON document for programs."""

from __future__ import annotations

import json
import os
import re
import sys
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console
from rich.table import Table
from rich.text import Text

if TYPE_CHECKING:
    from dohyo.evaluation.statistics import Estimate
    from dohyo.evaluation.summary import Summary

Json = Annotated[bool, typer.Option("--json", help="Print one JSON document.")]

CONTROL = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f]")


def plain(text: str) -> str:
    """Text of a stranger without the control characters that a terminal obeys; lines stay."""
    return CONTROL.sub("\N{REPLACEMENT CHARACTER}", text)


def print_error(text: str) -> None:
    """Prints one line on standard error; line breaks, which a stranger's name may hold, become spaces."""
    print(f"dohyo: {plain(' '.join(text.splitlines()))}", file=sys.stderr)


class PlainConsole(Console):
    """Shows strings as they are: no markup, and no control characters, since records and servers are strangers'.

    A line of text stays one line: terminals wrap it, and what is copied or read by a program is whole.
    """

    def print(self, *objects: Any, **options: Any) -> None:
        """See `Console.print`."""
        options.setdefault("soft_wrap", all(isinstance(one, str) for one in objects))
        super().print(*objects, **options)

    def render_str(self, text: str, **options: Any) -> Text:
        """See `Console.render_str`."""
        return super().render_str(plain(text), **options)


console = PlainConsole(markup=False)
DASH = "—"
UNLIMITED = 1_000_000
"""Width of a page for programs, characters; rich knows no infinite one."""
WHOLE = frozenset({"id", "name", "evaluation", "control"})
"""Columns of what a reader copies."""
WHOLE_SHARE = 0.75
"""Largest share of a terminal's width that these columns may take without being wrapped."""
RATES_FROM_KM = 0.1
"""Least route completed by all drives together for which infractions per km are shown, km."""

SCORES = {
    "success": "success %",
    "route_completion": "RC %",
    "infraction_penalty": "IP",
    "driving_score": "DS",
    "irs": "IRS",
}


def print_json(document: object) -> None:
    """Prints one JSON document on standard output, in ASCII where that cannot encode every character."""
    unicode = (sys.stdout.encoding or "").lower().replace("-", "") == "utf8"
    json.dump(document, sys.stdout, indent=1, ensure_ascii=not unicode)
    sys.stdout.write("\n")
    sys.stdout.flush()  # so that a pipe has each document of a command that goes on


def print_rows(columns: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """Prints a table; on a terminal the columns of `WHOLE` stay on one line where they fit."""
    table, rows = Table(box=None, header_style="bold", pad_edge=False), list(rows)
    whole = [place for place, column in enumerate(columns) if column in WHOLE]
    needed = sum(max((len(row[place]) for row in rows), default=0) for place in whole)
    for place, column in enumerate(columns):
        no_wrap = place in whole and needed <= WHOLE_SHARE * console.width
        table.add_column(column, overflow="fold", no_wrap=no_wrap)
    for row in rows:
        table.add_row(*row)
    _print_table(table)


def _print_table(table: Table) -> None:
    """Prints a table as wide as a terminal, or as COLUMNS says; else as its content, for programs that read lines."""
    bounded = console.is_terminal or "COLUMNS" in os.environ
    if not bounded:
        table.width = console.measure(table, options=console.options.update(width=UNLIMITED)).maximum
    console.print(table, crop=bounded)


def print_listing(entries: Sequence[Mapping[str, Any]], as_json: bool) -> None:
    """Prints entries that all have the same keys."""
    if as_json:
        print_json(list(entries))
        return
    columns = list(entries[0]) if entries else []
    print_rows(columns, [[_cell(entry[column]) for column in columns] for entry in entries])


def print_comparison(summaries: Sequence[Summary]) -> None:
    """Prints agents side by side: scores with intervals, then infractions per km."""
    table = Table(box=None, header_style="bold", pad_edge=False)
    table.add_column("")
    for summary in summaries:
        table.add_column(summary.agent, justify="right")
    for key, title in SCORES.items():
        table.add_row(title, *[interval(summary.scores[key]) for summary in summaries])
    table.add_section()
    if any(summary.km >= RATES_FROM_KM for summary in summaries):
        table.add_row(Text("infractions per km", "bold"))
        for kind in summaries[0].per_km:
            table.add_row(kind.replace("_", " "), *[_rate(summary, kind) for summary in summaries])
        table.add_section()
    table.add_row("episodes", *[str(summary.episodes) for summary in summaries])
    table.add_row("lost (gridlock, infrastructure)", *[str(summary.lost) for summary in summaries])
    if any(summary.lost for summary in summaries):
        table.add_section()
        table.add_row(Text("counting lost drives as 0", "bold"))
        for key, title in SCORES.items():
            table.add_row(title, *[interval((one.scores_lost_as_zero or one.scores)[key]) for one in summaries])
    _print_table(table)
    console.print(f"rules {summaries[0].rules}, IRS over km {summaries[0].irs_length}, 95 % intervals")


def _rate(summary: Summary, kind: str) -> str:
    """Infractions per km; a dash below the least distance, where an interval would be too wide."""
    return interval(summary.per_km[kind]) if summary.km >= RATES_FROM_KM else DASH


def print_part(part: str, of: str = "") -> None:
    """Prints that an agent has driven only a part of a benchmark, see `Result.part`; nothing if it drove all."""
    if part:
        console.print(f"{of}{part}; the scores are not those of the benchmark", highlight=False)


def print_cells(cells: Mapping[str, Summary], of: str = "") -> None:
    """Prints one row per cell of a benchmark, where there is more than one, under the name of the agent if given."""
    if len(cells) < 2:
        return
    if of:
        console.print(of, style="bold")
    titles = SCORES | {
        "nocrash_success": "NoCrash success %",
        "road_completed": "road without crash %",
        "drove_2500m": "2500 m without crash %",
    }
    far = any(summary.scores["drove_2500m"].mean for summary in cells.values())  # most routes are shorter
    shown = ("success", "nocrash_success", "road_completed", *(["drove_2500m"] if far else []), "driving_score")
    lost = any(summary.lost for summary in cells.values())
    rows = [
        (
            cell,
            *(interval(summary.scores[name]) for name in shown),
            str(summary.episodes),
            *([str(summary.lost)] if lost else []),
        )
        for cell, summary in cells.items()
    ]
    print_rows(["cell", *(titles[name] for name in shown), "n", *(["lost"] if lost else [])], rows)


def interval(estimate: Estimate) -> str:
    """Mean and interval, such as "78.4 [75.9, 80.6]"."""
    if estimate.mean is None:
        return DASH
    if estimate.low is None or estimate.high is None:
        return number(estimate.mean)
    return f"{number(estimate.mean)} [{number(estimate.low)}, {number(estimate.high)}]"


def number(value: float) -> str:
    """Three significant digits, and at least two decimals below 10."""
    if value == 0:
        return "0"
    if abs(value) < 0.1:
        return f"{value:.3g}"
    if abs(value) >= 100:
        return f"{value:.0f}"
    return f"{value:.1f}" if abs(value) >= 10 else f"{value:.2f}"


def _cell(value: Any) -> str:
    return ", ".join(map(str, value)) if isinstance(value, list | tuple) else str(value)
