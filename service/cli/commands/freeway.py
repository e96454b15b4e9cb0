"""`dohyo evaluate` on the benchmarks of the freeway: forecasters and controllers of connected cars."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from dohyo.evaluation.freeway.benchmark import ForecastBenchmark, days_folder, load_freeway_benchmark
from dohyo.evaluation.freeway.page import finding, unit_word, write_page
from dohyo.evaluation.freeway.result import FreewayResult, rows
from dohyo.service.cli.output import DASH, console, interval, number, print_json, print_rows
from dohyo.service.cli.progress import ProgressBar, ended_by_sigterm
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.freeway.dataset import make_dataset


def evaluate_on_freeway(
    agent: str,
    benchmark: str,
    settings: Mapping[str, Any],
    seeds: Sequence[int] | None,
    folder: Path,
    workers: int,
    as_json: bool,
) -> None:
    """Evaluates a forecaster or a controller; prints the result, and writes it as JSON and as an HTML report."""
    found = load_freeway_benchmark(benchmark)
    if isinstance(found, ForecastBenchmark):
        from dohyo.agents.forecasting.benchmark import evaluate_forecaster  # torch takes seconds to import

        if seeds is not None:
            raise InvalidInputError(f"benchmark '{found.name}' has fixed days: leave out --seeds")
        with ended_by_sigterm(), ProgressBar(f"days of {found.name}", hidden=as_json) as bar:
            result = evaluate_forecaster(found, agent, settings, folder, workers, _days(bar))
    else:
        from dohyo.agents.speed_planning.benchmark import evaluate_controller

        with ProgressBar(f"{agent} on {found.name}", hidden=as_json) as bar:
            result = evaluate_controller(found, agent, settings, seeds, folder, workers, _days(bar))
    page = write_page(folder, result)
    if as_json:
        print_json(result.document())
        return
    _print(result)
    console.print(f"report: {page.resolve()}")


def prepare_days(benchmark: str, workers: int) -> None:
    """Simulates the missing days of a forecast benchmark."""
    found = load_freeway_benchmark(benchmark)
    if not isinstance(found, ForecastBenchmark):
        raise InvalidInputError(
            f"benchmark '{found.name}' has nothing to prepare: its mornings are simulated during the evaluation"
        )
    with ended_by_sigterm(), ProgressBar(f"days of {found.name}") as bar:
        made = make_dataset(found.order, days_folder(found), _days(bar), workers)
    console.print(f"{made} made, {found.number - made} kept, in {days_folder(found)}")


def _days(bar: ProgressBar) -> Callable[[int, int, float], None]:
    """A function that shows finished days, all days, and the share of the current day."""
    return lambda done, total, share: bar(done + share, total)


def _print(result: FreewayResult) -> None:
    shown = [
        (
            f"{row.metric.title}, {row.metric.unit}",
            interval(row.ours),
            interval(row.theirs),
            DASH
            if row.percent is None or row.percent.mean is None
            else f"{row.percent.mean:+.1f} [{row.percent.low:+.1f}, {row.percent.high:+.1f}]"
            if row.percent.low is not None
            else f"{row.percent.mean:+.1f}",
            row.verdict,
        )
        for row in rows(result)
    ]
    print_rows(["", result.agent.name, result.reference, "difference, %", ""], shown)
    word = unit_word(result)
    console.print(f"{len(result.units)} {word}s, 95 % intervals over {word}s; record {result.record_hash[:12]}")
    for key, value in result.timing.items():
        console.print(f"{key.replace('_', ' ')}: {number(value)}")
    console.print(f"{result.agent.name}: {finding(result)}")
