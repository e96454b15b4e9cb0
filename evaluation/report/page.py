"""Report: one or several evaluations of a benchmark as one HTML file that needs no network."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import plotly.graph_objects as go
from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup
from plotly.offline import get_plotlyjs

from dohyo.evaluation.benchmarks.headline import Headline
from dohyo.evaluation.output_file import write_output
from dohyo.evaluation.records.record import Infraction
from dohyo.evaluation.records.specifications import InfractionKind
from dohyo.evaluation.report import figures
from dohyo.evaluation.report import style as look
from dohyo.evaluation.report.contenders import Contender, Evaluation, Pair
from dohyo.evaluation.report.recorded_versions import dohyo_versions, mixed_versions, sumo_versions
from dohyo.evaluation.report.road_map import LaneShape, Spot, drivable_lanes, lay_out_map
from dohyo.evaluation.report.rows import Drive, make_drives, worst_first
from dohyo.evaluation.report.style import MISSING, number
from dohyo.evaluation.report.tables import csv_tables
from dohyo.evaluation.scores.driving import IrsLength, Rules
from dohyo.evaluation.scores.nuplan.summary import ClosedLoopSummary, by_type, lost_drives
from dohyo.evaluation.statistics import Estimate

SHARED: Final = Path(__file__).parent / "static" / "shared"
"""Scripts and styles of tables, which the dashboard serves as they are."""


@dataclass(frozen=True, slots=True)
class Column:
    """A score as a column of the comparison.

    Attributes:
        key: Name in `Contender.scores`.
        title: Name for people.
        unit: Unit of the values.
        top: Upper end of the axis of all cells; the lower end is 0.
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
CLOSED_LOOP: Final = Column("closed_loop", "closed-loop score", "%", 100.0)
DROVE_2500M: Final = Column("drove_2500m", "2500 m without crash", "%", 100.0)
"""A column only where it is the headline: most routes are shorter."""


TypeRow = tuple[str, ClosedLoopSummary]
"""A type of scenario and its summary."""


@dataclass(frozen=True, slots=True)
class Picture:
    """A plotly figure in parts, so that the page can set its title and colours."""

    name: str
    title: Markup
    caption: str
    height: int
    document: Markup


def write_report(
    contenders: Sequence[Contender],
    pairs: Sequence[Pair],
    path: Path,
    *,
    lanes: Callable[[str], Iterable[LaneShape]] = drivable_lanes,
) -> Path:
    """Writes one self-contained HTML file; the same records give the same bytes.

    Args:
        contenders: At least one agent.
        pairs: Comparisons of all of them, see `make_pairs`.
        path: Path of the file; missing folders are created. Links to records are relative to it.
        lanes: Function that returns the lanes of a network to draw, by its name in the scenarios.

    Returns:
        The path of the written file.

    Raises:
        InvalidInputError: If the file cannot be written.
    """
    contenders = sorted(contenders, key=lambda one: one.place)
    evaluations, rules = [one.evaluation for one in contenders], contenders[0].summary.rules
    drives = sorted(make_drives(contenders, path, rules), key=worst_first)
    counted = [drive for drive in drives if not drive.record.lost]
    networks = sorted({drive.record.scenario.network for drive in drives})
    page = {
        "evaluation": evaluations[0],
        "headline": _in_a_sentence(evaluations[0].headline),
        "partly": any(one.part for one in evaluations),
        "mixed_versions": mixed_versions([(one.agent, one.records) for one in evaluations]),
        "facts": _facts(evaluations, rules, contenders[0].summary.irs_length),
        "contenders": contenders,
        "closed_loop": _closed_loop(contenders),
        "columns": _columns(contenders),
        "kinds": [kind for kind in InfractionKind if any(one.summary.per_km[kind].mean for one in contenders)],
        "per_km_top": _per_km_top(contenders),
        "pairs": pairs,
        "pictures": list(_pictures(contenders, rules)),
        "maps": [lay_out_map(network, _marks(counted, network), lanes) for network in networks],
        "drives": counted,
        "lost": [drive for drive in drives if drive.record.lost],
        "tables": csv_tables(contenders, pairs, counted),
    }
    write_output(path, _environment().get_template("report.html.j2").render(page).encode())
    return path


def _in_a_sentence(headline: Headline) -> str:
    """The headline after "has", such as "a driving score" or "an infraction rate score"."""
    name = f"{headline.label.removesuffix(' score')} score"
    return f"{'an' if name[0] in 'aeiou' else 'a'} {name}"


def _columns(contenders: Sequence[Contender]) -> list[Column]:
    """Scores that all agents have, the benchmark's headline first."""
    headline = contenders[0].evaluation.headline
    shown = [*COLUMNS]
    if all(one.closed_loop for one in contenders):
        shown.append(CLOSED_LOOP)
    if headline is Headline.DROVE_2500M:
        shown.append(DROVE_2500M)
    return sorted(shown, key=lambda column: column.key != headline)


def _closed_loop(contenders: Sequence[Contender]) -> list[tuple[Contender, ClosedLoopSummary, list[TypeRow]]]:
    """Closed-loop summary of each agent, over all drives and by type; empty if the records have no reference."""
    found = [(one, one.closed_loop) for one in contenders if one.closed_loop]
    if len(found) < len(contenders):
        return []
    return [(one, scored.summary, list(by_type(scored.drives).items())) for one, scored in found]


def _environment() -> Environment:
    loader = PackageLoader("dohyo.evaluation.report", "templates")
    environment = Environment(
        loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    palettes = {scheme: look.template(scheme).to_plotly_json() for scheme in look.PALETTES}
    environment.globals.update(
        infraction_kinds=tuple(InfractionKind),
        missing=MISSING,
        styles=Markup(loader.get_source(environment, "styles.css")[0]),
        script=Markup(loader.get_source(environment, "report.js")[0]),
        table_styles=_shared("interactive.css"),
        table_script=_shared("interactive.js"),
        plotly=Markup(get_plotlyjs()),
        plotly_templates=_script_json(palettes),
    )
    environment.filters.update(
        number=number,
        or_blank=lambda value: "" if value is None else value,
        share=lambda value, top: f"{100 * min(1.0, max(0.0, value / top)):.2f}%",
        reach=_reach,
        ending=look.ending,
        probability=look.probability,
        spot_text=_spot_text,
        route_text=_route_text,
    )
    return environment


def _shared(name: str) -> Markup:
    """A file that the dashboard serves and the report contains."""
    return Markup((SHARED / name).read_text(encoding="utf-8"))


def _reach(estimate: Estimate, bottom: float, top: float) -> str:
    """Mean and ends of an interval as shares of an axis, for the script that zooms the axis."""
    values = (estimate.mean, estimate.low, estimate.high)
    shares = (((estimate.mean or 0.0) if value is None else value) - bottom for value in values)
    return " ".join(f"{min(1.0, max(0.0, share / (top - bottom))):.5g}" for share in shares)


def _facts(evaluations: Sequence[Evaluation], rules: Rules, irs_length: IrsLength) -> list[tuple[str, str, str]]:
    """Name, value and note of the facts that a reader needs to trust or to repeat the numbers."""
    records = [record for one in evaluations for record in one.records]
    seeds = sorted({record.scenario.seed for record in records})
    per_agent = "; ".join(f"{one.agent}: {len(one.records)}" for one in evaluations)
    return [
        ("benchmark hash", evaluations[0].benchmark_hash[:8] or MISSING, evaluations[0].benchmark_hash),
        ("rules", rules, "Version of the CARLA Leaderboard's rules behind IP and DS"),
        (
            "IRS length",
            irs_length,
            "The infraction rate score divides by the route completed, the distance driven, or the route's length",
        ),
        ("seeds", str(len(seeds)), ", ".join(map(str, seeds))),
        ("episodes", str(len(records)), per_agent),
        ("lost", str(lost_drives(records)), "Drives lost to gridlocks and infrastructure faults"),
        ("network", ", ".join(sorted({one.scenario.network for one in records})), "Networks of the episodes"),
        ("SUMO", sumo_versions(records), "Version of the traffic simulation"),
        ("dohyo", dohyo_versions(records), "Version of dohyo that drove the episodes"),
    ]


def _per_km_top(contenders: Sequence[Contender]) -> float:
    """Upper end of the common axis of all rates."""
    rates = [rate for one in contenders for rate in one.summary.per_km.values()]
    return max((rate.high or rate.mean or 0.0 for rate in rates), default=0.0) or 1.0


def _pictures(contenders: Sequence[Contender], rules: Rules) -> Iterator[Picture]:
    """The figures that have data."""
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
    """JSON that is safe in a script element, whatever strings it contains."""
    return Markup(json.dumps(document, sort_keys=True, separators=(",", ":")).replace("<", "\\u003c"))


def _marks(drives: Iterable[Drive], network: str) -> Iterator[tuple[Drive, Infraction]]:
    for drive in drives:
        if drive.record.scenario.network == network:
            yield from ((drive, infraction) for infraction in drive.ego.infractions)


def _spot_text(spot: Spot[Drive]) -> str:
    """Text of a mark on the map: one fact per line."""
    return "\n".join(
        (
            f"{spot.infraction.kind.specification.label}: {spot.drive.contender.name}",
            f"{spot.drive.mission}, seed {spot.drive.record.scenario.seed}",
            *_details(spot.infraction),
        )
    )


def _route_text(infraction: Infraction) -> str:
    """Text of a mark on the bar of a route."""
    return ", ".join((infraction.kind.specification.label, *_details(infraction)))


def _details(infraction: Infraction) -> Iterator[str]:
    yield f"after {number(infraction.time_s)} s, {number(infraction.route_m)} m along the route"
    if infraction.magnitude:
        yield f"{number(infraction.magnitude)} {infraction.unit}"
    if infraction.actor is not None:
        yield f"with {infraction.actor}"
    if infraction.at_fault is not None:
        yield "at fault" if infraction.at_fault else "not at fault"
