"""Report: one or several evaluations of a benchmark as one HTML file that needs no network."""

from __future__ import annotations

import csv
import dataclasses
import io
import itertools
import json
import math
import os
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote

import plotly.graph_objects as go
from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup
from plotly.offline import get_plotlyjs

from evaluation import figures
from evaluation.closed_loop import (
    ClosedLoopSummary,
    applies,
    by_type,
    lost_episodes,
    score_records,
    summarise_closed_loop,
)
from evaluation.figures import ENDINGS, MARKS, MISSING, number
from evaluation.record import EgoRecord, EpisodeRecord, Infraction, InfractionKind
from evaluation.road_map import LaneShape, Spot, draw_map, drivable_lanes
from evaluation.scores.driving import (
    IrsLength,
    Rules,
    driving_score,
    infraction_penalty,
    outside_fraction,
    route_completion,
)
from evaluation.statistics import Comparison, Estimate
from evaluation.store import write_atomically
from evaluation.summary import Summary, compare, summarise
from sumo_networks.errors import InvalidInputError


@dataclass(frozen=True, slots=True)
class Column:
    """A score as a column of the comparison.

    Attributes:
        key: Its name in `Summary.scores`.
        title: For a reader.
        unit: Of its values.
        top: Upper end of the axis that all cells share; the lower is 0.
    """

    key: str
    title: str
    unit: str
    top: float


COLUMNS = (
    Column("driving_score", "driving score DS", "%", 100.0),
    Column("route_completion", "route completion RC", "%", 100.0),
    Column("infraction_penalty", "infraction penalty IP", "0-1", 1.0),
    Column("irs", "infraction rate score IRS", "%", 100.0),
    Column("success", "success", "%", 100.0),
    Column("nocrash_success", "success without crash", "%", 100.0),
)


@dataclass(frozen=True, slots=True)
class Evaluation:
    """One agent on one benchmark, as the report needs it.

    Attributes:
        agent: Its name, unique in the report.
        benchmark: Name of the benchmark.
        benchmark_hash: Content hash of the benchmark.
        records: Of all episodes, lost ones included.
        record_paths: Their JSON files, in the same order.
    """

    agent: str
    benchmark: str
    benchmark_hash: str
    records: tuple[EpisodeRecord, ...]
    record_paths: tuple[Path, ...]

    def __post_init__(self) -> None:
        if len(self.records) != len(self.record_paths):
            raise InvalidInputError(
                f"expected one path per record of '{self.agent}', got {len(self.records)} records and "
                f"{len(self.record_paths)} paths"
            )


@dataclass(frozen=True, slots=True)
class Contender:
    """An agent in the report: its place, colour and numbers."""

    place: int
    name: str
    colour: str
    evaluation: Evaluation
    summary: Summary


TypeRow = tuple[str, ClosedLoopSummary]
"""A type of scenario and its summary."""


@dataclass(frozen=True, slots=True)
class Term:
    """A piece of a score's formula, and what it stands for."""

    text: str
    note: str


@dataclass(frozen=True, slots=True)
class Drive:
    """One ego of one episode, as a row of the table."""

    anchor: str
    contender: Contender
    record: EpisodeRecord
    ego: EgoRecord
    href: str
    mission: str
    score: float
    why: tuple[Term, ...]


@dataclass(frozen=True, slots=True)
class Pair:
    """Two agents and how they compare; without a drive in common, only the reason why not."""

    a: Contender
    b: Contender
    comparisons: dict[str, Comparison]
    reason: str


@dataclass(frozen=True, slots=True)
class Picture:
    """A plotly figure taken apart, so that the page can set its title and colours itself."""

    name: str
    title: Markup
    caption: str
    height: int
    document: Markup


def write_report(
    evaluations: Sequence[Evaluation],
    path: Path,
    *,
    rules: Rules = "2.0",
    irs_length: IrsLength = "driven",
    lanes: Callable[[str], Iterable[LaneShape]] = drivable_lanes,
) -> Path:
    """Writes one self-contained HTML file; the same records give the same bytes.

    Args:
        evaluations: Of different agents on the same version of one benchmark.
        path: Where to write; missing folders are created. Records are linked relative to it.
        rules: Version of the leaderboard's rules behind penalty and driving score.
        irs_length: What length the infraction rate score divides by.
        lanes: The lanes to draw of a network, by its name in the scenarios.

    Returns:
        The path written.

    Raises:
        InvalidInputError: If there is no evaluation, an agent comes twice, the benchmarks differ, or records cannot be
            summarised together.
    """
    _check(evaluations)
    contenders = _contenders(evaluations, rules, irs_length)
    drives = sorted(_drives(contenders, path, rules), key=_worst_first)
    counted = [drive for drive in drives if not figures.lost(drive.record)]
    pairs = [_pair(a, b, rules, irs_length) for a, b in itertools.combinations(contenders, 2)]
    networks = sorted({drive.record.scenario.network for drive in drives})
    page = {
        "evaluation": evaluations[0],
        "facts": _facts([one.evaluation for one in contenders], rules, irs_length),
        "contenders": contenders,
        "closed_loop": _closed_loop(contenders),
        "columns": COLUMNS,
        "kinds": [kind for kind in InfractionKind if any(one.summary.per_km[kind].mean for one in contenders)],
        "per_km_top": _per_km_top(contenders),
        "pairs": pairs,
        "pictures": list(_pictures(contenders, rules)),
        "maps": [draw_map(network, _marks(counted, network), lanes) for network in networks],
        "drives": counted,
        "lost": [drive for drive in drives if figures.lost(drive.record)],
        "tables": _tables(contenders, pairs, counted),
    }
    path.parent.mkdir(parents=True, exist_ok=True)
    write_atomically(path, _environment().get_template("report.html.j2").render(page).encode())
    return path


def _closed_loop(contenders: Sequence[Contender]) -> list[tuple[Contender, ClosedLoopSummary, list[TypeRow]]]:
    """Each agent's closed-loop summary, as a whole and by type; empty where the records have no reference."""
    found = []
    for one in contenders:
        records = one.evaluation.records
        if not all(map(applies, records)):
            return []
        drives = score_records(zip(records, one.evaluation.record_paths, strict=True))
        summary = summarise_closed_loop(drives, lost_episodes(records))
        found.append((one, summary, list(by_type(drives).items())))
    return found


def _check(evaluations: Sequence[Evaluation]) -> None:
    if not evaluations:
        raise InvalidInputError("expected at least one evaluation to report, got none")
    names = Counter(one.agent for one in evaluations)
    if twice := [name for name, count in names.items() if count > 1]:
        raise InvalidInputError(f"expected one evaluation per agent, got several of {', '.join(sorted(twice))}")
    versions = {(one.benchmark, one.benchmark_hash) for one in evaluations}
    if len(versions) > 1:
        given = ", ".join(f"{name} ({digest[:12]})" for name, digest in sorted(versions))
        raise InvalidInputError(f"expected evaluations of one benchmark version, got {given}")


def _environment() -> Environment:
    loader = PackageLoader("evaluation", "templates")
    environment = Environment(
        loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    palettes = {scheme: figures.template(scheme).to_plotly_json() for scheme in figures.PALETTES}
    environment.globals.update(
        marks=MARKS,
        missing=MISSING,
        styles=Markup(loader.get_source(environment, "styles.css")[0]),
        script=Markup(loader.get_source(environment, "report.js")[0]),
        plotly=Markup(get_plotlyjs()),
        plotly_templates=_script_json(palettes),
    )
    environment.filters.update(
        number=number,
        share=lambda value, top: f"{100 * min(1.0, max(0.0, value / top)):.2f}%",
        ending=figures.ending,
        meaning=lambda status: ENDINGS[status][0],
        spot_text=_spot_text,
        route_text=_route_text,
    )
    return environment


def _contenders(evaluations: Sequence[Evaluation], rules: Rules, irs_length: IrsLength) -> list[Contender]:
    """Best driving score first; agents without any score last."""
    colours = figures.agent_colours(one.agent for one in evaluations)
    found = [(one, summarise(one.records, rules=rules, irs_length=irs_length)) for one in evaluations]
    found.sort(key=lambda pair: (-_mean(pair[1].scores["driving_score"]), pair[0].agent))
    return [Contender(place, one.agent, colours[one.agent], one, summary) for place, (one, summary) in enumerate(found)]


def _mean(estimate: Estimate) -> float:
    return -math.inf if estimate.mean is None else estimate.mean


def _facts(evaluations: Sequence[Evaluation], rules: Rules, irs_length: IrsLength) -> list[tuple[str, str, str]]:
    """Name, value and a note on hover: what a reader needs to trust or to repeat the numbers."""
    records = [record for one in evaluations for record in one.records]
    seeds = sorted({record.scenario.seed for record in records})
    per_agent = "; ".join(f"{one.agent}: {len(one.records)}" for one in evaluations)
    return [
        ("benchmark hash", evaluations[0].benchmark_hash[:8] or MISSING, evaluations[0].benchmark_hash),
        ("rules", rules, "Version of the CARLA Leaderboard's rules behind IP and DS"),
        (
            "IRS length",
            irs_length,
            "The infraction rate score divides by the distance driven, or by the route's length",
        ),
        ("seeds", str(len(seeds)), ", ".join(map(str, seeds))),
        ("episodes", str(len(records)), per_agent),
        ("lost", str(sum(map(figures.lost, records))), "Episodes lost to the infrastructure; they enter no mean"),
        ("network", _listed(record.scenario.network for record in records), "Where the episodes took place"),
        (
            "SUMO",
            _listed(record.versions.sumo.removeprefix("SUMO ") for record in records),
            "Version of the traffic simulation",
        ),
        ("dohyo", _listed(record.versions.dohyo for record in records), "Version that drove the episodes"),
    ]


def _listed(values: Iterable[str]) -> str:
    return ", ".join(sorted(set(values)))


def _drives(contenders: Sequence[Contender], path: Path, rules: Rules) -> Iterator[Drive]:
    folder = path.parent.resolve()
    for contender in contenders:
        one = contender.evaluation
        for i, (record, file) in enumerate(zip(one.records, one.record_paths, strict=True)):
            href = quote(Path(os.path.relpath(file.resolve(), folder)).as_posix())
            for j, ego in enumerate(record.egos):
                yield Drive(
                    anchor=f"drive-{contender.place}-{i}-{j}",
                    contender=contender,
                    record=record,
                    ego=ego,
                    href=href,
                    mission=figures.mission_name(record, ego),
                    score=driving_score(ego, rules),
                    why=tuple(_why(ego, rules)),
                )


def _worst_first(drive: Drive) -> tuple[float, str, int, str]:
    return drive.score, drive.mission, drive.record.scenario.seed, drive.contender.name


def _why(ego: EgoRecord, rules: Rules) -> Iterator[Term]:
    """The driving score, factor by factor, such as 80 x 0.6 x 0.7 = 33.6."""
    yield Term(_factor(route_completion(ego)), "route completed, %")
    if outside := outside_fraction(ego):
        yield Term(f" × {_factor(1 - outside)}", f"{number(ego.outside_lanes_m)} m driven outside lanes")
    factors = [(one, infraction_penalty((one,), rules, 0.0)) for one in ego.infractions]
    notes = [(factor, f"{MARKS[one.kind].label} at {number(one.time_s)} s") for one, factor in factors if factor < 1]
    if rules == "2.1" and notes:
        yield Term(" / (1", "rules 2.1 divide by one plus the costs")
        yield from (Term(f" + {_factor(1 / factor - 1)}", note) for factor, note in notes)
        yield Term(")", "rules 2.1 divide by one plus the costs")
    else:
        yield from (Term(f" × {_factor(factor)}", note) for factor, note in notes)
    if not outside and not notes:
        yield Term(" × 1", "no infraction lowers the score")
    yield Term(f" = {number(driving_score(ego, rules))}", "driving score DS, %")


def _factor(value: float) -> str:
    """Like `number`, without trailing zeros: people write 0.6, not 0.600."""
    return f"{value:.3g}"


def _pair(a: Contender, b: Contender, rules: Rules, irs_length: IrsLength) -> Pair:
    try:
        comparisons = compare(a.evaluation.records, b.evaluation.records, rules=rules, irs_length=irs_length)
    except InvalidInputError as error:
        return Pair(a, b, {}, str(error))
    return Pair(a, b, comparisons, "")


def _per_km_top(contenders: Sequence[Contender]) -> float:
    """Upper end of the axis that all rates share."""
    rates = [rate for one in contenders for rate in one.summary.per_km.values()]
    return max((rate.high or rate.mean or 0.0 for rate in rates), default=0.0) or 1.0


def _pictures(contenders: Sequence[Contender], rules: Rules) -> Iterator[Picture]:
    """Those figures that have something to show."""
    records = {one.name: one.evaluation.records for one in contenders}
    if any(one.summary.episodes for one in contenders):
        yield _picture("score-by-mission", figures.score_by_mission(records, rules=rules))
    yield _picture("episode-endings", figures.episode_endings(records))
    if any(rate.mean for one in contenders for rate in one.summary.per_km.values()):
        yield _picture("infractions-along-route", figures.infractions_along_route(records))


def _picture(name: str, figure: go.Figure) -> Picture:
    document = json.loads(figure.to_json())
    layout = document["layout"]
    title = layout.pop("title")
    del layout["template"]
    layout["margin"] = {"t": 32, **layout.get("margin", {})}
    return Picture(
        name=name,
        title=Markup(title["text"]),
        caption=title["subtitle"]["text"],
        height=layout["height"] - 56,
        document=_script_json(document),
    )


def _script_json(document: object) -> Markup:
    """JSON that can stand in a script element, whatever the strings in it say."""
    return Markup(json.dumps(document, sort_keys=True, separators=(",", ":")).replace("<", "\\u003c"))


def _marks(drives: Iterable[Drive], network: str) -> Iterator[tuple[Drive, Infraction]]:
    for drive in drives:
        if drive.record.scenario.network == network:
            yield from ((drive, infraction) for infraction in drive.ego.infractions)


def _spot_text(spot: Spot[Drive]) -> str:
    """What a mark on the map says on hover: one fact per line."""
    return "\n".join(
        (
            f"{MARKS[spot.infraction.kind].label}: {spot.drive.contender.name}",
            f"{spot.drive.mission}, seed {spot.drive.record.scenario.seed}",
            *_details(spot.infraction),
        )
    )


def _route_text(infraction: Infraction) -> str:
    """What a mark on the bar of a route says on hover."""
    return ", ".join((MARKS[infraction.kind].label, *_details(infraction)))


def _details(infraction: Infraction) -> Iterator[str]:
    yield f"after {number(infraction.time_s)} s, {number(infraction.route_m)} m along the route"
    if infraction.magnitude:
        yield f"{number(infraction.magnitude)} {infraction.unit}"
    if infraction.actor is not None:
        yield f"with {infraction.actor}"
    if infraction.at_fault is not None:
        yield "at fault" if infraction.at_fault else "not at fault"


def _tables(contenders: Sequence[Contender], pairs: Sequence[Pair], drives: Sequence[Drive]) -> dict[str, str]:
    """Every table of the page as CSV."""
    return {
        "scores": _estimate_table(contenders, lambda summary: summary.scores),
        "rates": _estimate_table(contenders, lambda summary: summary.per_km),
        "pairs": _pair_table(pairs),
        "drives": _drive_table(drives),
    }


def _csv(header: Iterable[str], rows: Iterable[Iterable[object]]) -> str:
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(header)
    writer.writerows([_csv_cell(value) for value in row] for row in rows)
    return buffer.getvalue()


def _csv_cell(value: object) -> object:
    """Text that a spreadsheet would take for a formula is quoted; None is empty."""
    formula = isinstance(value, str) and len(value) > 1 and value[0] in "=+-@"
    return f"'{value}" if formula else value


def _estimate_table(contenders: Iterable[Contender], estimates: Callable[[Summary], dict[str, Estimate]]) -> str:
    rows = (
        (one.name, name, *dataclasses.astuple(estimate))
        for one in contenders
        for name, estimate in estimates(one.summary).items()
    )
    return _csv(("agent", "quantity", "mean", "low", "high", "n"), rows)


def _pair_table(pairs: Iterable[Pair]) -> str:
    rows = (
        (pair.a.name, pair.b.name, name, one.verdict, one.probability, *dataclasses.astuple(one.difference))
        for pair in pairs
        for name, one in pair.comparisons.items()
    )
    header = ("a", "b", "quantity", "verdict", "probability", "difference mean", "low", "high", "n")
    return _csv(header, rows)


def _drive_table(drives: Iterable[Drive]) -> str:
    rows = (
        (
            drive.contender.name,
            drive.mission,
            drive.record.scenario.seed,
            drive.ego.status.value,
            drive.ego.failure,
            drive.score,
            route_completion(drive.ego),
            len(drive.ego.infractions),
            drive.record.record_hash,
        )
        for drive in drives
    )
    header = ("agent", "mission", "seed", "status", "failure", "DS", "RC", "infractions", "record_hash")
    return _csv(header, rows)
