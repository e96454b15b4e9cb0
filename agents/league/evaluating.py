"""Evaluating: one entrant in one discipline, as rows; a second call with the same folder does only what is missing."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, Final

from dohyo.agents.forecasting.benchmark import evaluate_forecaster
from dohyo.agents.league.edition import Discipline, Entrant
from dohyo.agents.registry import kind_of, resolve, resolve_with
from dohyo.agents.speed_planning.benchmark import evaluate_controller
from dohyo.agents.studies.arms import Cell
from dohyo.agents.studies.rows import Row
from dohyo.evaluation.benchmarks.benchmark import load_benchmark
from dohyo.evaluation.benchmarks.part import select
from dohyo.evaluation.families import Family
from dohyo.evaluation.freeway.benchmark import ForecastBenchmark, TrafficBenchmark, load_freeway_benchmark
from dohyo.evaluation.freeway.result import FreewayResult
from dohyo.evaluation.parking.benchmark import load_parking_benchmark
from dohyo.evaluation.parking.evaluate import evaluate_parking
from dohyo.evaluation.parking.record import ParkingRecord
from dohyo.evaluation.parking.result import count_karts
from dohyo.evaluation.records.record import EpisodeRecord
from dohyo.evaluation.running.executors import ProcessPool
from dohyo.evaluation.running.run import Result, run_benchmark
from dohyo.evaluation.scores.driving import Rules, infraction_rate_score
from dohyo.evaluation.scores.nuplan.summary import score_records
from dohyo.evaluation.summary import score_drive
from dohyo.sumo_networks.errors import InvalidInputError

Progress = Callable[[float, int], None]
"""Called with what is done and the total."""


def evaluate(
    discipline: Discipline, entrant: Entrant, out: Path, workers: int = 1, progress: Progress = lambda done, total: None
) -> list[Row]:
    """A row per drive, lot, day or morning.

    Args:
        discipline: The discipline.
        entrant: The entrant.
        out: Folder of the result, as `dohyo evaluate` writes it.
        workers: Number of processes.
        progress: Called as drives end.

    Raises:
        InvalidInputError: The folder holds another evaluation.
        SimulationError: SUMO failed.
    """
    return list(_EVALUATE[discipline.family](discipline, entrant, out, workers, progress))


def check_entrant(entrant: Entrant) -> None:
    """Checks what can be checked of an entrant before it drives.

    Raises:
        InvalidInputError: Its weights are missing, or no agent that drives or parks is registered under its name.
    """
    _ = entrant.parameters
    if entrant.family in (Family.DRIVING, Family.PARKING):
        resolve(entrant.registered)


def missions_of(discipline: Discipline) -> tuple[str, ...]:
    """Missions to choose from, as patterns for `run_benchmark`.

    Raises:
        InvalidInputError: Even-numbered missions are wanted, and the missions have no numbers.
    """
    if not discipline.even:
        return discipline.only
    scenarios = load_benchmark(discipline.benchmark).scenarios([0])
    numbers = {one.name: one.name.rpartition(".m")[2] for one in select(scenarios, discipline.only)}
    if unnumbered := [name for name, number in numbers.items() if not number.isdecimal()]:
        raise InvalidInputError(f"even: expected missions with numbers such as town.m3, got '{unnumbered[0]}'")
    return tuple(name for name, number in numbers.items() if int(number) % 2 == 0)


def _drives(discipline: Discipline, entrant: Entrant, out: Path, workers: int, progress: Progress) -> Iterator[Row]:
    entry, settings = resolve_with(entrant.registered, dict(entrant.settings))
    result = run_benchmark(
        discipline.benchmark,
        entry,
        settings=settings,
        kind=kind_of(entry, settings),
        seeds=discipline.seeds,
        only=missions_of(discipline),
        sample=discipline.sample,
        out=out,
        executor=ProcessPool(workers),
        progress=lambda record, done, total: progress(done, total),
    )
    closed = _closed_loop(result)
    for record in result.records:
        name, seed = record.scenario.name, record.scenario.seed
        rules = result.manifest.benchmark.rules
        measured = {"lost": record.egos[0].status.value} if record.lost else _measures(record, rules)
        yield {**_cell(discipline, entrant, name, seed), **measured, **closed.get((name, seed), {})}


def _closed_loop(result: Result) -> dict[tuple[str, int], Row]:
    """The closed-loop score of each drive, where the benchmark is scored by it."""
    if not result.manifest.benchmark.closed_loop:
        return {}
    scored = score_records(zip(result.records, result.paths, strict=True))
    return {(one.scenario, one.seed): {"closed_loop": one.terms.score} for one in scored}


def _measures(record: EpisodeRecord, rules: Rules) -> Row:
    """Scores of a drive in % by the rules of its benchmark, its infractions, and the median time of a decision, ms."""
    ego = record.egos[0]
    scores = score_drive(ego, rules=rules)
    decision = record.timing.decision_ms.get(ego.name) if record.timing is not None else None
    return {
        "status": ego.status.value,
        **{name: scores[name] for name in ("driving_score", "nocrash_success", "success", "route_completion")},
        "irs": infraction_rate_score(ego),
        "driven_m": ego.driven_m,
        "infractions": dict(Counter(one.kind.value for one in ego.infractions)),
        "decision_ms": None if decision is None else round(decision[0], 3),
        "record_hash": record.record_hash,
    }


def _lots(discipline: Discipline, entrant: Entrant, out: Path, workers: int, progress: Progress) -> Iterator[Row]:
    entry, settings = resolve(entrant.registered), dict(entrant.settings)
    benchmark = load_parking_benchmark(discipline.benchmark)
    first, count = discipline.seeds
    seeds = range(first, first + count)
    records = evaluate_parking(benchmark, entry, settings, kind_of(entry, settings), seeds, out, workers, progress)
    for record in records:
        yield {**_cell(discipline, entrant, "lot", record.seed), **_of_lot(record)}


def _of_lot(record: ParkingRecord) -> Row:
    """Shares of the karts of a lot, %, and their mean time, s; None where none parked."""
    counts = count_karts(record)
    return {
        "success": 100.0 * counts.parked / counts.karts,
        "aligned": 100.0 * counts.aligned / counts.parked if counts.parked else None,
        "time_s": sum(counts.times_s) / counts.parked if counts.parked else None,
        "record_hash": record.record_hash,
    }


def _forecasts(discipline: Discipline, entrant: Entrant, out: Path, workers: int, progress: Progress) -> Iterator[Row]:
    benchmark = load_freeway_benchmark(discipline.benchmark)
    assert isinstance(benchmark, ForecastBenchmark)
    told = _told(progress)
    result = evaluate_forecaster(benchmark, entrant.registered, dict(entrant.settings), out, workers, told)
    return _of_freeway(discipline, entrant, result)


def _mornings(discipline: Discipline, entrant: Entrant, out: Path, workers: int, progress: Progress) -> Iterator[Row]:
    benchmark = load_freeway_benchmark(discipline.benchmark)
    assert isinstance(benchmark, TrafficBenchmark)
    told = _told(progress)
    name, settings = entrant.registered, dict(entrant.settings)
    result = evaluate_controller(benchmark, name, settings, discipline.seeds, out, workers, told)
    return _of_freeway(discipline, entrant, result)


def _told(progress: Progress) -> Callable[[int, int, float], None]:
    return lambda done, total, share: progress(done + share, total)


def _of_freeway(discipline: Discipline, entrant: Entrant, result: FreewayResult) -> Iterator[Row]:
    """A row per day or morning; their hash is that of the whole result."""
    for number, (unit, values) in enumerate(result.units.items()):
        seed = discipline.seeds[number] if discipline.seeds else None
        decision = result.timing.get("latency_core_ms")
        yield {
            **_cell(discipline, entrant, unit, seed), **values, "decision_ms": decision,
            "record_hash": result.record_hash,
        }  # fmt: skip


def _cell(discipline: Discipline, entrant: Entrant, scenario: str, seed: int | None) -> Mapping[str, Any]:
    return Cell(entrant.name, None, discipline.name, scenario, seed)._asdict()


_EVALUATE: Final[Mapping[Family, Callable[[Discipline, Entrant, Path, int, Progress], Iterator[Row]]]] = {
    Family.DRIVING: _drives,
    Family.PARKING: _lots,
    Family.FORECASTING: _forecasts,
    Family.FREEWAY: _mornings,
}
