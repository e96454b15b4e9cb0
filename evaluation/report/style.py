"""Style of all figures, tables and pages: palettes, marks of infractions, the form of numbers."""

from __future__ import annotations

import hashlib
import html
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal

import plotly.graph_objects as go

from dohyo.evaluation.records.specifications import Status
from dohyo.evaluation.statistics import Estimate

Scheme = Literal["light", "dark"]

OKABE_ITO = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#D55E00", "#F0E442", "#999999")
"""The eight colours of Okabe and Ito, with grey instead of black, since a page may be dark."""
SANS = "ui-sans-serif, system-ui, sans-serif"
MISSING = "\N{EM DASH}"
TOO_FEW = "too few to decide"
"""In place of a probability where fewer than six pairs differ; the dashboard has the same words."""


@dataclass(frozen=True, slots=True)
class Palette:
    """The colours that differ between light and dark pages.

    Attributes:
        panel: Background of figures and tables.
        ink: Colour of text.
        quiet: Colour of secondary text.
        line: Colour of hairlines and grids.
        success: Colour of drives that reached the goal.
        warning: Colour of drives in which the agent failed as a program.
        infraction: Colour of drives in which the agent failed as a driver.
        infrastructure: Colour of drives that were lost.
    """

    panel: str
    ink: str
    quiet: str
    line: str
    success: str
    warning: str
    infraction: str
    infrastructure: str


PALETTES: Mapping[Scheme, Palette] = MappingProxyType(
    {
        "light": Palette("#FFFFFF", "#1F2328", "#6B7280", "#E5E0D8", "#2E7D5B", "#B7791F", "#B3362E", "#6B7280"),
        "dark": Palette("#1C1F25", "#E8E6E1", "#9AA3AF", "#2C3038", "#4CAF86", "#D69A3A", "#E5675E", "#9AA3AF"),
    }
)


def agent_colours(agents: Iterable[str]) -> dict[str, str]:
    """A colour per agent, computed from its name, so that it is the same on every page.

    If two agents of one page have the same colour, the later name gets the next free one; grey comes last.
    """
    *hues, grey = OKABE_ITO
    colours: dict[str, str] = {}
    free: set[str] = set()
    for agent in sorted(set(agents)):
        free = free or {*hues, grey}
        first = int.from_bytes(hashlib.sha256(agent.encode()).digest()[:4]) % len(hues)
        colours[agent] = next(colour for colour in (*hues[first:], *hues[:first], grey) if colour in free)
        free.remove(colours[agent])
    return colours


def template(scheme: Scheme = "light") -> go.layout.Template:
    """The plotly template of all figures."""
    palette = PALETTES[scheme]
    axis = {
        "gridcolor": palette.line,
        "linecolor": palette.line,
        "zeroline": False,
        "automargin": True,
        "title": {"font": {"size": 12, "color": palette.quiet}, "standoff": 8},
    }
    layout = {
        "font": {"family": SANS, "size": 13, "color": palette.ink},
        "paper_bgcolor": palette.panel,
        "plot_bgcolor": palette.panel,
        "colorway": OKABE_ITO,
        "title": {
            "x": 0,
            "xref": "paper",
            "xanchor": "left",
            "font": {"size": 16, "weight": 600},
            "subtitle": {"font": {"size": 12, "color": palette.quiet}},
        },
        "xaxis": axis,
        "yaxis": axis,
        "legend": {"orientation": "h", "x": 0, "y": 1, "yanchor": "bottom", "yref": "paper", "traceorder": "normal"},
        "hoverlabel": {
            "bgcolor": palette.panel,
            "bordercolor": palette.quiet,
            "font": {"family": SANS, "color": palette.ink},
            "align": "left",
        },
        "margin": {"l": 8, "r": 16, "t": 88, "b": 48},
        "bargap": 0.4,
    }
    scatter = {
        "marker": {"size": 9, "line": {"width": 1, "color": palette.ink}},
        "error_x": {"thickness": 1.3, "width": 0, "color": palette.quiet},
    }
    bar = {
        "marker": {
            "line": {"width": 1, "color": palette.panel},
            "pattern": {"fillmode": "overlay", "fgcolor": palette.panel, "fgopacity": 0.4, "size": 7},
        }
    }
    return go.layout.Template(layout=layout, data={"scatter": [scatter], "bar": [bar]})


def ending(status: Status) -> str:
    """A status without the word before its colon, which repeats its colour and sign."""
    return status.value.rpartition(": ")[2].removeprefix("agent ").removeprefix("agent's ")


def label(text: str) -> str:
    """A name from a record, escaped, since plotly reads markup in texts."""
    return html.escape(text, quote=False)


def interval(estimate: Estimate) -> str:
    """An estimate as text, such as `78.4 [75.9, 80.6] n=75`."""
    if estimate.mean is None:
        return MISSING
    if estimate.low is None or estimate.high is None:
        return f"{number(estimate.mean)} n={estimate.n}"
    return f"{number(estimate.mean)} [{number(estimate.low)}, {number(estimate.high)}] n={estimate.n}"


def probability(value: float | None, a: str = "A", b: str = "B") -> str:
    """Probability that `a` scores higher than `b`, such as `P(A > B) = 0.873`; the dashboard has the same form."""
    if value is None:
        return TOO_FEW
    if value >= 0.9995:
        return f"P({a} > {b}) > 0.999"
    if value < 0.0005:
        return f"P({a} > {b}) < 0.001"
    return f"P({a} > {b}) = {value:.3f}"


def markdown(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table in Markdown."""
    return "\n".join(f"| {' | '.join(row)} |" for row in (heads, ["---"] * len(heads), *rows))


def number(value: float) -> str:
    """A number to three significant digits, in plain notation and without a trailing point."""
    if value == 0 or abs(value) < 5e-4:
        return "0"
    if abs(value) >= 999.5:
        return f"{value:.0f}"
    return f"{value:#.3g}".removesuffix(".")
