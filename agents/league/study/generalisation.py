"""Study `generalisation`: every learned driver in the town and conditions of its training, and where it never was.

    python -m dohyo.agents.studies generalisation run
    python -m dohyo.agents.studies generalisation table --write
    python -m dohyo.agents.studies generalisation figures --out docs/pictures

The two towns differ, too. Therefore the autopilot drives the same missions, which learned in neither: what a driver
loses beyond it is the price of not having been there. Row 29 of the theses' comparisons.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Final

import plotly.graph_objects as go

from dohyo.agents.endless_driving.study.judging import measures
from dohyo.agents.studies.arms import Arm, Block, Cell, cells_of
from dohyo.agents.studies.driving import driven
from dohyo.agents.studies.rows import Row, by_arm
from dohyo.agents.studies.runner import Job, row_each
from dohyo.agents.studies.samples import Sample, scenario_of
from dohyo.agents.studies.study import Results, Study
from dohyo.agents.studies.tables import fixed
from dohyo.agents.studies.unseen import PLACES, gap, gap_beyond, place_of
from dohyo.evaluation.report.pictures import write_page
from dohyo.evaluation.report.style import MISSING, PALETTES, markdown, template
from dohyo.evaluation.statistics import share_estimate
from dohyo.sumo_networks.config import Config

ARMS: Final[Mapping[str, Arm]] = MappingProxyType(
    {
        "autopilot": Arm("autopilot", isolates="learned nowhere"),
        "ghrl": Arm("ghrl", isolates="town-train, exact state"),
        "priboot": Arm("priboot", isolates="town-train, district, Ingolstadt, Braunschweig; view from above"),
        "griad": Arm("griad", isolates="town-train, exact state"),
        "rlfold": Arm("rlfold", isolates="town-train, one camera"),
        "rlad": Arm("rlad", isolates="town-train, one camera"),
    }
)
CONTROL: Final = "autopilot"
MISSIONS: Final = Sample("nocrash", every=5)
OUTCOMES: Final = {"success": "success, %", "lawful_success": "lawful success, %"}
KEPT: Final = ("status", "success", "lawful_success", "route_completion", "route_m", "driven_m", "infractions")
SIZE: Final = (980, 420)


class Options(Config):
    """The study has no options: the shipped weights drive."""


def cells(options: Options) -> list[Cell]:
    """All drivers on every fifth mission of all twelve cells of NoCrash."""
    return cells_of([Block([*ARMS], (None,), MISSIONS.places())])


def work(options: Options, job: Job) -> Iterator[Row]:
    """The drives of one driver in one cell; one that fails is a lost row."""

    def measured(cell: Cell) -> Row:
        found = measures(*driven(scenario_of(cell), ARMS[cell.arm].make()))
        return {**cell._asdict(), **{name: found[name] for name in KEPT}}

    return row_each(job, measured)


def gap_section(results: Results) -> str:
    """A row per driver and outcome: success by place, what it loses, and what it loses beyond the control."""
    places, lines = _places(results), []
    control = places.get(CONTROL)
    for arm, groups in places.items():
        for outcome, head in OUTCOMES.items():
            shares = [[bool(row[outcome]) for row in group] for group in groups]
            told = [fixed(share_estimate(some)) for some in shares]
            pairs = [_beside(groups[at], control[at], outcome) for at in (0, -1)] if arm != CONTROL and control else []
            beyond = fixed(gap_beyond(*pairs)) if pairs and all(pairs) else MISSING
            lines.append([arm, ARMS[arm].isolates, head, *told, fixed(gap(shares[0], shares[-1])), beyond])
    heads = ["driver", "learned in", "NoCrash", *PLACES, "gap", f"beyond the {CONTROL}'s"]
    return markdown(heads, lines) if lines else ""


def figure(results: Results) -> go.Figure:
    """Lawful success of each driver where it learned, and where neither town nor conditions were seen."""
    ends = {
        arm: [share_estimate([bool(row["lawful_success"]) for row in group]).mean for group in (groups[0], groups[-1])]
        for arm, groups in _places(results).items()
    }
    order = sorted(ends, key=lambda arm: (ends[arm][0] or 0.0) - (ends[arm][1] or 0.0), reverse=True)
    drawn = go.Figure()
    for arm in order:
        line = {"color": PALETTES["light"].quiet, "width": 2}
        drawn.add_scatter(x=ends[arm], y=[arm, arm], mode="lines", line=line, showlegend=False, hoverinfo="skip")
    ink = PALETTES["light"].ink
    for number, name, colour in ((0, "town and conditions of the training", ink), (1, "both unseen", "white")):
        marker = {"size": 13, "color": colour, "line": {"color": ink, "width": 2}}
        drawn.add_scatter(x=[ends[arm][number] for arm in order], y=order, mode="markers", name=name, marker=marker)
    drawn.update_yaxes(autorange="reversed")
    drawn.update_xaxes(title="success without a red light or stop sign run, %", range=[-3, 103])
    return drawn.update_layout(
        template=template(), width=SIZE[0], height=SIZE[1], margin={"t": 90, "b": 120},
        legend={"orientation": "h", "y": -0.38},
        title={"text": "What holds where nobody learned", "subtitle": {"text": "NoCrash in all amounts of traffic"}},
    )  # fmt: skip


def figures(results: Results, folder: Path) -> Sequence[Path]:
    """Draws the figure into a folder."""
    return write_page(figure(results), folder / "league-gap.html", "Gap of generalisation")


def _places(results: Results) -> dict[str, list[list[Row]]]:
    """Rows of each driver by place, of those that drove in every one."""
    found = {
        arm: [[row for row in own if place_of(row["scenario"]) == place] for place in PLACES.values()]
        for arm, own in by_arm(results.kept, ARMS).items()
    }
    return {arm: groups for arm, groups in found.items() if all(groups)}


def _beside(rows: Sequence[Row], others: Sequence[Row], outcome: str) -> list[tuple[bool, bool]]:
    """Whether a driver and another one succeed, on each mission that both drove."""
    beside = {row["scenario"]: bool(row[outcome]) for row in others}
    return [(bool(row[outcome]), beside[row["scenario"]]) for row in rows if row["scenario"] in beside]


STUDY: Final = Study(
    summary="all learned drivers: towns and conditions never seen",
    room=Path(__file__).parents[1],
    options=Options,
    cells=cells,
    work=work,
    tables={"gap": gap_section},
    together=lambda cell: (cell.arm, cell.scenario.rpartition(".")[0]),
    fresh=True,
    figures=figures,
    published="generalisation",
)
