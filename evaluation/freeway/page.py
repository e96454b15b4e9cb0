"""The page of one result on a benchmark of the freeway: one HTML file that needs no network and no script."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from dohyo.evaluation.freeway.benchmark import ForecastBenchmark, TrafficBenchmark
from dohyo.evaluation.freeway.result import RESULT, FreewayResult, Row, rows
from dohyo.evaluation.output_file import write_output
from dohyo.evaluation.report.style import MISSING, number

PAGE = "report.html"


@dataclass(frozen=True, slots=True)
class Shown:
    """One row of the table.

    Attributes:
        row: Metric with its estimates.
        why: Reason for a missing difference.
        top: Upper end of the axis of both estimates.
    """

    row: Row
    why: str
    top: float


@dataclass(frozen=True, slots=True)
class Pair:
    """Headline value of one unit, of the agent and of the reference."""

    name: str
    ours: float
    theirs: float


def write_page(out: Path, result: FreewayResult) -> Path:
    """Writes the page beside the result's file.

    Raises:
        InvalidInputError: The file cannot be written.
    """
    write_output(out / PAGE, page(result).encode())
    return out / PAGE


def page(result: FreewayResult) -> str:
    """The page as text."""
    loader = PackageLoader("dohyo.evaluation.report", "templates")
    environment = Environment(loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True)
    environment.filters.update(number=number, share=_share, signed=lambda value: f"{value:+.1f}")
    shown, pairs = [_shown(row) for row in rows(result)], _pairs(result)
    ends = [value for pair in pairs for value in (pair.ours, pair.theirs)]
    low, high = min(ends, default=0.0), max(ends, default=1.0)
    room = 0.05 * (high - low) or 1.0
    return environment.get_template("freeway.html.j2").render(
        styles=Markup(loader.get_source(environment, "styles.css")[0]),
        benchmark=result.benchmark,
        agent=result.agent,
        reference=result.reference,
        finding=finding(result),
        facts=_facts(result),
        rows=shown,
        pairs=pairs,
        first=result.metrics[0],
        bottom=low - room,
        top=high + room,
        unit_word=unit_word(result),
        data=RESULT,
        missing=MISSING,
    )


def finding(result: FreewayResult) -> str:
    """The result on the headline metric, as a sentence."""
    first = result.metrics[0]
    ours, theirs = result.estimates[first.key], result.reference_estimates[first.key]
    said = f"{first.title} {number(ours.mean or 0.0)} ({first.unit})"
    if result.agent.name == result.reference or theirs.mean is None or first.key not in result.comparisons:
        return f"{said}.{_no_rank(result)}"
    verdict = {"<": "less than", ">": "more than", "=": "not significantly different from"}[
        result.comparisons[first.key].verdict
    ]
    return f"{said}, {verdict} {result.reference}'s {number(theirs.mean)}.{_no_rank(result)}"


def _no_rank(result: FreewayResult) -> str:
    """A second sentence where fewer vehicles passed than the benchmark asks for; else nothing."""
    least = result.benchmark.least_throughput_vph if isinstance(result.benchmark, TrafficBenchmark) else 0.0
    passed = result.estimates["throughput_vph"].mean if least else None
    if passed is None or passed >= least:
        return ""
    return f" A run with a throughput of {number(passed)} veh/h, below {number(least)}, has no rank."


def unit_word(result: FreewayResult) -> str:
    """Word for one unit: day or seed."""
    return "day" if isinstance(result.benchmark, ForecastBenchmark) else "seed"


def _facts(result: FreewayResult) -> list[tuple[str, str]]:
    settings = ", ".join(f"{key}={value}" for key, value in result.agent.settings.items())
    facts = [
        ("benchmark", result.benchmark.sha256[:12]),
        (f"{unit_word(result)}s", str(len(result.units))),
        ("settings", settings or MISSING),
        ("record", result.record_hash[:12]),
        *((key, value[:12]) for key, value in result.versions.items()),
    ]
    return facts + [(key.replace("_", " "), number(value)) for key, value in result.timing.items()]


def _shown(row: Row) -> Shown:
    why = "as of the squared errors above" if row.metric.root else "nothing to compare with"
    ends = [value for one in (row.ours, row.theirs) for value in (one.mean, one.high) if value is not None]
    return Shown(row, why, 1.05 * max(ends, default=1.0) or 1.0)


def _pairs(result: FreewayResult) -> list[Pair]:
    key = result.metrics[0].key
    both = [name for name in result.units if name in result.reference_units]
    return [Pair(name, result.units[name][key], result.reference_units[name][key]) for name in both]


def _share(value: float, whole: float) -> str:
    return f"{min(max(100 * value / whole, 0.0), 100.0):.2f}%"
