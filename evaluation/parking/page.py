"""The report of parking: one HTML file with rates and plan views that needs no network and no script."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from dohyo.evaluation.output_file import write_output
from dohyo.evaluation.parking.plan import plan_view
from dohyo.evaluation.parking.record import ParkingRecord
from dohyo.evaluation.parking.result import MEASURES, ParkingResult, compare_parking, summarise_parking
from dohyo.evaluation.report.recorded_versions import DIFFERENT
from dohyo.evaluation.report.style import MISSING, number
from dohyo.evaluation.statistics import Comparison
from dohyo.sumo_networks.arrays import Float32Array
from dohyo.sumo_networks.errors import InvalidInputError

PLANS = 9
"""Plan views of each agent."""
Motions = Mapping[int, Float32Array]


@dataclass(frozen=True, slots=True)
class Evaluated:
    """One agent of a report.

    Attributes:
        name: Unique name on the page.
        records: Its records.
        motions: Motion of the lots in `shown_records`, by seed; empty: there are no plan views.
        part: What is there of the lots that were ordered, in words for people; "" if all are.
    """

    name: str
    records: Sequence[ParkingRecord]
    motions: Motions
    part: str = ""


@dataclass(frozen=True, slots=True)
class _Manoeuvre:
    caption: str
    parked: bool
    svg: Markup


def shown_records(records: Sequence[ParkingRecord]) -> list[ParkingRecord]:
    """Records whose manoeuvres a report shows: failures of each kind first, then parked ones from all times."""
    lost: list[ParkingRecord] = []
    parked: list[ParkingRecord] = []
    for one in records:
        (parked if all(kart.parked for kart in one.karts) else lost).append(one)
    kinds: dict[tuple[str, str], list[ParkingRecord]] = {}
    for one in lost:
        worst = next(kart for kart in one.karts if not kart.parked)
        kinds.setdefault((worst.ending, worst.touched), []).append(one)
    chosen = [some[0] for some in kinds.values()]
    chosen += [one for some in kinds.values() for one in some[1:]]
    chosen = chosen[: PLANS - PLANS // 2 + 1]
    parked.sort(key=lambda one: max(kart.time_s for kart in one.karts))
    room = min(PLANS - len(chosen), len(parked))
    return chosen + [parked[(2 * index + 1) * len(parked) // (2 * room)] for index in range(room)]


def write_parking_page(path: Path, evaluated: Sequence[Evaluated]) -> Path:
    """Writes the report.

    Raises:
        InvalidInputError: The agents were evaluated on different benchmarks, or the file cannot be written.
    """
    if len({one.records[0].benchmark.sha256 for one in evaluated}) != 1:
        raise InvalidInputError("these evaluations are on different benchmarks; compare one at a time")
    write_output(path, _page(evaluated).encode())
    return path


def comparisons(evaluated: Sequence[Evaluated]) -> Iterator[tuple[str, str, Comparison | None]]:
    """Names of each pair of agents, with the comparison of their success rates; None without a common lot."""
    for first, second in combinations(evaluated, 2):
        common = {one.seed for one in first.records} & {one.seed for one in second.records}
        yield first.name, second.name, compare_parking(first.records, second.records) if common else None


def dohyo_versions(records: Iterable[ParkingRecord]) -> str:
    """Versions of dohyo that drove the lots, such as "0.9.0, 1.0.0"."""
    return ", ".join(sorted({record.version for record in records}))


def mixed_versions(evaluated: Sequence[Evaluated]) -> str:
    """Sentence that names the versions of dohyo behind each agent, if they are not all the same; else ""."""
    if len({record.version for one in evaluated for record in one.records}) < 2:
        return ""
    return f"{DIFFERENT} " + "; ".join(f"{one.name}: dohyo {dohyo_versions(one.records)}" for one in evaluated)


def _page(evaluated: Sequence[Evaluated]) -> str:
    loader = PackageLoader("dohyo.evaluation.report", "templates")
    environment = Environment(loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True)
    results = [(one.name, summarise_parking(one.records)) for one in evaluated]
    tops = {one.key: _top(one.key, [result for _, result in results]) for one in MEASURES}
    environment.filters.update(number=number, share=_share, signed=lambda value: f"{value:+.1f}")
    first = evaluated[0].records[0]
    return environment.get_template("parking.html.j2").render(
        styles=Markup(loader.get_source(environment, "styles.css")[0]),
        benchmark=first.benchmark,
        facts=[
            ("benchmark", first.benchmark.sha256[:12]),
            ("lots", ", ".join(sorted({str(len(one.records)) for one in evaluated}))),
            ("karts in a lot", str(first.benchmark.karts)),
            ("dohyo", dohyo_versions(record for one in evaluated for record in one.records)),
        ],
        parts=[(one.name, one.part) for one in evaluated if one.part],
        mixed_versions=mixed_versions(evaluated),
        results=results,
        measures=MEASURES,
        tops=tops,
        comparisons=list(comparisons(evaluated)),
        manoeuvres=[(one.name, list(_manoeuvres(one))) for one in evaluated if one.motions],
        missing=MISSING,
    )


def _manoeuvres(one: Evaluated) -> Iterator[_Manoeuvre]:
    for record in shown_records(one.records):
        if record.seed in one.motions:
            parked = all(kart.parked for kart in record.karts)
            svg = Markup(plan_view(record, one.motions[record.seed]))
            yield _Manoeuvre(_caption(record), parked, svg)


def _caption(record: ParkingRecord) -> str:
    """What happened in a lot, for people."""
    said = []
    for kart in record.karts:
        if kart.parked:
            fit = "aligned" if kart.aligned else "not aligned"
            said.append(
                f"parked after {kart.time_s:.1f} s, {fit} ({kart.inclination_deg:.1f}°, {kart.deviation_m:.2f} m)"
            )
        elif kart.failure:
            said.append(f"failed: {kart.failure}")
        elif kart.touched != "nothing":
            said.append(f"in contact with a {kart.touched} after {kart.time_s:.1f} s")
        else:
            said.append(f"out of time, {kart.distance_m:.1f} m from its spot")
    return f"lot {record.seed}: " + "; ".join(said)


def _top(key: str, results: Sequence[ParkingResult]) -> float:
    """Upper end of the axis of a measure."""
    if key != "time_s":
        return 100.0
    ends = [
        value for one in results for value in (one.estimates[key].mean, one.estimates[key].high) if value is not None
    ]
    return 1.05 * max(ends, default=1.0) or 1.0


def _share(value: float, whole: float) -> str:
    return f"{min(max(100 * value / whole, 0.0), 100.0):.2f}%"
