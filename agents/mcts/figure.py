"""Picture of a search: trajectories over the map, and the tree of decisions; both coloured by Q."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from dohyo.evaluation.report.style import PALETTES, template
from dohyo.sumo_networks.arrays import FloatArray

LANE, EGO = "#D9D4CA", "#5B4B8A"
SCALE = "Viridis"
BANDS = 16
VIEW_M = (-15.0, 90.0)
MOST_DRAWN = 400


def draw_search(
    why: dict[str, Any],
    pose: Sequence[float],
    lanes: Iterable[tuple[FloatArray, float]],
    boxes: FloatArray,
    title: str,
) -> go.Figure:
    """Draws one explanation of `mbappe` or `random-shooting`.

    Args:
        why: Result of `explain`.
        pose: x, y [m], heading [rad] of the ego, network frame.
        lanes: Centrelines (P, 2) [m] and widths [m], network frame.
        boxes: (N, 5) x, y, heading, length, width of all actors at that moment, the ego first, network frame.
        title: Of the picture.
    """
    nodes: list[dict[str, Any]] = why["nodes"]
    figure = make_subplots(
        cols=2, column_widths=[0.6, 0.4], horizontal_spacing=0.06, subplot_titles=("explored from here", "the tree")
    )
    _draw_lanes(figure, pose, lanes)
    _draw_boxes(figure, pose, boxes)
    low, high = _range(nodes)
    _draw_trajectories(figure, nodes, low, high)
    _draw_plan(figure, why)
    _draw_tree(figure, why, low, high)
    caption = f"{why['simulations']} simulations, {why['nodes_made']} nodes; thick: the plan; colour: mean return Q"
    figure.update_layout(
        template=template(), title={"text": title, "subtitle": {"text": caption}}, height=640, showlegend=False,
        margin={"t": 110},
    )  # fmt: skip
    figure.update_xaxes(range=VIEW_M, title="ahead, m", col=1)
    figure.update_yaxes(scaleanchor="x", scaleratio=1, range=(-30, 30), title="left, m", col=1)
    figure.update_xaxes(title="actions ahead", dtick=1, col=2)
    figure.update_yaxes(visible=False, col=2)
    return figure


def _range(nodes: list[dict[str, Any]]) -> tuple[float, float]:
    values = [node["q"] for node in nodes] or [0.0, 1.0]
    return min(values), max(max(values), min(values) + 1e-6)


def _into_ego_frame(points: FloatArray, pose: Sequence[float]) -> FloatArray:
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    return np.asarray((points - np.asarray(pose[:2])) @ np.array([[cos, -sin], [sin, cos]]))


def _joined(lines: Iterable[FloatArray]) -> tuple[list[float | None], list[float | None]]:
    """Polylines as one trace, with gaps."""
    x: list[float | None] = []
    y: list[float | None] = []
    for line in lines:
        x += [*np.round(line[:, 0], 2).tolist(), None]
        y += [*np.round(line[:, 1], 2).tolist(), None]
    return x, y


def _draw_lanes(figure: go.Figure, pose: Sequence[float], lanes: Iterable[tuple[FloatArray, float]]) -> None:
    near = [_into_ego_frame(shape, pose) for shape, _ in lanes]
    x, y = _joined(line for line in near if np.hypot(*line.T).min() < 150.0)
    figure.add_trace(go.Scatter(x=x, y=y, mode="lines", line={"color": LANE, "width": 6}, hoverinfo="skip"), 1, 1)


def _draw_boxes(figure: go.Figure, pose: Sequence[float], boxes: FloatArray) -> None:
    for i, (x, y, heading, length, width) in enumerate(boxes):
        corners = 0.5 * np.array([[length, width], [length, -width], [-length, -width], [-length, width]])
        corners = np.vstack([corners, corners[:1]])
        turn = np.array([[math.cos(heading), math.sin(heading)], [-math.sin(heading), math.cos(heading)]])
        outline = _into_ego_frame(corners @ turn + (x, y), pose)
        colour = EGO if i == 0 else PALETTES["light"].quiet
        figure.add_trace(
            go.Scatter(
                x=outline[:, 0], y=outline[:, 1], mode="lines", fill="toself", line={"color": colour, "width": 1},
                hoverinfo="skip",
            ), 1, 1,
        )  # fmt: skip


def _draw_trajectories(figure: go.Figure, nodes: list[dict[str, Any]], low: float, high: float) -> None:
    """Traces by band of Q, the best on top."""
    from plotly.colors import sample_colorscale

    drawn = sorted(nodes, key=lambda node: -int(node["n"]))[:MOST_DRAWN]
    band = [min(int((node["q"] - low) / (high - low) * BANDS), BANDS - 1) for node in drawn]
    for number in range(BANDS):
        x, y = _joined(np.array(node["trajectory"]) for node, which in zip(drawn, band, strict=True) if which == number)
        if x:
            colour = sample_colorscale(SCALE, [number / (BANDS - 1)])[0]
            line = {"color": colour, "width": 1.2}
            figure.add_trace(go.Scatter(x=x, y=y, mode="lines", line=line, opacity=0.7, hoverinfo="skip"), 1, 1)


def _draw_plan(figure: go.Figure, why: dict[str, Any]) -> None:
    known = {node["node"]: node for node in why["nodes"]}
    pieces = [np.array(known[node]["trajectory"]) for node in why["plan"] if node in known]
    if pieces:
        line = np.vstack(pieces)
        figure.add_trace(
            go.Scatter(x=line[:, 0], y=line[:, 1], mode="lines", line={"color": EGO, "width": 4}, name="plan"), 1, 1
        )


def _draw_tree(figure: go.Figure, why: dict[str, Any], low: float, high: float) -> None:
    nodes = why["nodes"]
    place = _layout(nodes)
    x, y = _joined(
        np.array([[max(node["depth"] - 1, 0), place[node["parent"]]], [node["depth"], place[node["node"]]]])
        for node in nodes
    )
    line = {"color": PALETTES["light"].line, "width": 1}
    figure.add_trace(go.Scatter(x=x, y=y, mode="lines", line=line, hoverinfo="skip"), 1, 2)
    plan = set(why["plan"])
    figure.add_trace(
        go.Scatter(
            x=[node["depth"] for node in nodes],
            y=[place[node["node"]] for node in nodes],
            mode="markers",
            marker={
                "size": [4 + 2.5 * math.log2(1 + node["n"]) for node in nodes],
                "symbol": ["x" if node["failed"] else "circle" for node in nodes],
                "color": [node["q"] for node in nodes],
                "cmin": low, "cmax": high, "colorscale": SCALE,
                "colorbar": {"title": "Q", "thickness": 10},
                "line": {"width": [3 if node["node"] in plan else 0 for node in nodes], "color": EGO},
            },
            text=[_words(node) for node in nodes],
            hovertemplate="%{text}<extra></extra>",
        ), 1, 2,
    )  # fmt: skip


def _layout(nodes: list[dict[str, Any]]) -> dict[int, float]:
    """Height of every node: leaves evenly spaced, the others in the middle of their children."""
    children: dict[int, list[dict[str, Any]]] = {}
    for node in nodes:
        children.setdefault(node["parent"], []).append(node)
    place: dict[int, float] = {}
    free = 0.0
    stack: list[tuple[int, bool]] = [(0, False)]
    while stack:
        number, opened = stack.pop()
        below = children.get(number, [])
        if not below:
            place[number], free = free, free + 1.0
        elif opened:
            place[number] = sum(place[child["node"]] for child in below) / len(below)
        else:
            stack.append((number, True))
            below = sorted(below, key=lambda child: (child["steering"], child["acceleration"]))
            stack += [(child["node"], False) for child in below]
    return place


def _words(node: dict[str, Any]) -> str:
    terms = ", ".join(f"{name} {value:g}" for name, value in node["reward"].items())
    action = f"{node['acceleration']:+g} m/s^2, steering {node['steering']:+g}"
    return f"{action}<br>Q {node['q']:g}, N {node['n']}, P {node['p']:g}<br>{terms}"
