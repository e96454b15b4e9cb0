"""Figures of evaluations, made from records."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from dohyo.evaluation.records.record import EgoRecord, EpisodeRecord, Infraction
from dohyo.evaluation.records.specifications import InfractionKind, Status
from dohyo.evaluation.report.style import PALETTES, agent_colours, ending, interval, label, number, template
from dohyo.evaluation.scores.driving import Rules, driving_score
from dohyo.evaluation.statistics import Estimate, mean_estimate
from dohyo.sumo_networks.arrays import FloatArray

Records = Mapping[str, Sequence[EpisodeRecord]]
"""The records of each agent, by its name."""


def scored(records: Iterable[EpisodeRecord]) -> Iterator[tuple[EpisodeRecord, EgoRecord]]:
    """Every drive that enters a score; all drives of a lost episode are left out."""
    return ((record, ego) for record in records if not record.lost for ego in record.egos)


def mission_name(record: EpisodeRecord, ego: EgoRecord) -> str:
    """Name of the scenario, with the name of the ego if there are several."""
    return record.scenario.name if len(record.scenario.missions) == 1 else f"{record.scenario.name} / {ego.name}"


def score_by_mission(records: Records, *, rules: Rules = "2.0") -> go.Figure:
    """Driving score of every agent on every mission, hardest at the top, with intervals over seeds.

    Args:
        records: Records by agent.
        rules: Version of the leaderboard's rules.
    """
    estimates = {agent: _mission_estimates(some, rules) for agent, some in records.items()}
    missions = _hardest_first(estimates)
    colours = agent_colours(records)
    figure = go.Figure()
    for agent, shift in zip(records, _shifts(len(records)), strict=True):
        found = [(mission, estimates[agent][mission]) for mission in missions if mission in estimates[agent]]
        means = [one.mean or 0.0 for _, one in found]
        figure.add_scatter(
            x=means,
            y=[missions.index(mission) + shift for mission, _ in found],
            mode="markers",
            name=label(agent),
            marker_color=colours[agent],
            cliponaxis=False,
            error_x={
                "symmetric": False,
                "array": [_reach(one.high, mean) for (_, one), mean in zip(found, means, strict=True)],
                "arrayminus": [_reach(one.low, mean) for (_, one), mean in zip(found, means, strict=True)],
            },
            hovertext=[f"<b>{label(name)}</b><br>{label(agent)}: DS {interval(one)}" for name, one in found],
            hoverinfo="text",
        )
    episodes = sum(one.n for by_mission in estimates.values() for one in by_mission.values())
    _entitle(figure, _mission_finding(estimates, missions), f"Mean and 95 % interval over seeds; {episodes} drives.")
    figure.update_xaxes(title_text=f"driving score, rules {rules}, %", range=[-1, 101])
    figure.update_yaxes(
        tickvals=list(range(len(missions))),
        ticktext=[label(mission) for mission in missions],
        range=[len(missions) - 0.5, -0.5],
        showgrid=False,
    )
    return figure.update_layout(height=160 + len(missions) * max(24, 13 * len(records)), showlegend=True)


def infractions_along_route(records: Records) -> go.Figure:
    """Infractions along the routes: the rate in every tenth above, each infraction by kind below.

    Args:
        records: Records by agent.
    """
    kinds = [kind for kind in InfractionKind if any(one.kind is kind for one, _ in _infractions(records))]
    figure = make_subplots(rows=2, shared_xaxes=True, vertical_spacing=0.06, row_heights=[150, 60 + 30 * len(kinds)])
    colours = agent_colours(records)
    for agent, shift in zip(records, _shifts(len(records)), strict=True):
        figure.add_bar(
            x=[10 * tenth + 5 for tenth in range(10)],
            y=_rate_by_tenth(records[agent]),
            name=label(agent),
            legendgroup=label(agent),
            marker_color=colours[agent],
            hovertemplate="%{y:.2f} per km<extra>" + label(agent) + "</extra>",
            row=1,
            col=1,
        )
        own = list(_infractions({agent: records[agent]}))
        figure.add_scatter(
            x=[100 * min(1.0, one.route_m / ego.route_length_m) for one, ego in own],
            y=[kinds.index(one.kind) + shift for one, _ in own],
            mode="markers",
            marker={
                "color": colours[agent],
                "symbol": [one.kind.specification.mark.symbol for one, _ in own],
                "line": {"width": 0.7},
            },
            hovertext=[f"{label(agent)}: {one.kind.specification.label} at {number(one.route_m)} m" for one, _ in own],
            hoverinfo="text",
            legendgroup=label(agent),
            showlegend=False,
            row=2,
            col=1,
        )
    shares = [one.route_m / ego.route_length_m for one, ego in _infractions(records)]
    half = f"Half of the {len(shares)} infractions lie in the first {100 * np.median(shares or [0]):.0f} % of the route"
    _entitle(
        figure,
        half if len(shares) > 1 else f"{len(shares) or 'No'} infraction along the routes",
        "Above: infractions per km completed in that tenth of the route. Below: each infraction.",
    )
    figure.update_xaxes(range=[-1.5, 101.5])
    figure.update_xaxes(title_text="share of the route, %", row=2, col=1)
    figure.update_yaxes(title_text="per km", rangemode="tozero", row=1, col=1)
    figure.update_yaxes(
        tickvals=list(range(len(kinds))),
        ticktext=[kind.specification.label for kind in kinds],
        range=[len(kinds) - 0.5, -0.5],
        showgrid=False,
        row=2,
        col=1,
    )
    return figure.update_layout(height=360 + 32 * len(kinds), barmode="group", showlegend=True)


def episode_endings(records: Records) -> go.Figure:
    """Number of drives of each agent by their ending; lost drives are shown although they enter no score.

    A lost episode is lost for all of its egos, whose drives are shown by its fault.

    Args:
        records: Records by agent.
    """
    counts = {
        agent: Counter(one.fault or ego.status for one in some for ego in one.egos) for agent, some in records.items()
    }
    palette = PALETTES["light"]
    figure = go.Figure()
    for status in Status:
        if not any(count[status] for count in counts.values()):
            continue
        figure.add_bar(
            y=[label(agent) for agent in records],
            x=[counts[agent][status] for agent in records],
            orientation="h",
            name=ending(status),
            marker={"color": getattr(palette, status.outcome), "pattern": {"shape": status.hatch}},
            text=[counts[agent][status] or "" for agent in records],
            textposition="inside",
            insidetextanchor="middle",
            textangle=0,
            hovertemplate=f"%{{y}}: %{{x}} {ending(status)}<extra></extra>",
        )
    reached = ", ".join(
        f"{label(agent)} {sum(n for status, n in count.items() if status.completed)}"
        f" of {sum(n for status, n in count.items() if not status.infrastructure_fault)}"
        for agent, count in counts.items()
    )
    _entitle(figure, f"Goals reached: {reached}", "Number of drives by how they ended; lost drives enter no score.")
    figure.update_xaxes(title_text="drives")
    figure.update_yaxes(autorange="reversed", showgrid=False)
    return figure.update_layout(
        height=264 + 40 * len(records),
        barmode="stack",
        showlegend=True,
        legend={"yref": "container", "y": 0, "yanchor": "bottom"},
        margin_b=128,
    )


def _mission_estimates(records: Iterable[EpisodeRecord], rules: Rules) -> dict[str, Estimate]:
    scores: dict[str, list[float]] = {}
    for record, ego in scored(records):
        scores.setdefault(mission_name(record, ego), []).append(driving_score(ego, rules))
    return {mission: mean_estimate(values) for mission, values in scores.items()}


def _hardest_first(estimates: Mapping[str, Mapping[str, Estimate]]) -> list[str]:
    """Missions in the order of the mean driving score over agents, then by name."""
    means: dict[str, list[float]] = {}
    for by_mission in estimates.values():
        for mission, one in by_mission.items():
            means.setdefault(mission, []).append(one.mean or 0.0)
    return sorted(means, key=lambda mission: (float(np.mean(means[mission])), mission))


def _mission_finding(estimates: Mapping[str, Mapping[str, Estimate]], missions: Sequence[str]) -> str:
    if not missions:
        return "No mission has a drive that counts"
    hardest = f"'{label(missions[0])}' is the hardest of {len(missions)} missions"
    if len(missions) == 1:
        hardest = f"'{label(missions[0])}' is the only mission"
    wins = Counter(_best(estimates, mission) for mission in missions)
    del wins[None]
    if len(estimates) < 2 or not wins:
        return hardest
    (best, won), *_ = wins.most_common(1)
    return f"{label(str(best))} has the best mean on {won} of {len(missions)} missions; {hardest}"


def _best(estimates: Mapping[str, Mapping[str, Estimate]], mission: str) -> str | None:
    """The agent with the highest mean on a mission; None if two agents share it."""
    means = {agent: by_mission[mission].mean or 0.0 for agent, by_mission in estimates.items() if mission in by_mission}
    best = max(means.values())
    leaders = [agent for agent, mean in means.items() if mean == best]
    return leaders[0] if len(leaders) == 1 else None


def _infractions(records: Records) -> Iterator[tuple[Infraction, EgoRecord]]:
    return ((one, ego) for some in records.values() for _, ego in scored(some) for one in ego.infractions)


def _rate_by_tenth(records: Iterable[EpisodeRecord]) -> list[float | None]:
    """Infractions per km completed in each tenth of the route; None if less than 100 m were completed there."""
    km, counts = np.zeros(10), np.zeros(10)
    for _, ego in scored(records):
        tenth_m = ego.route_length_m / 10
        km += np.clip(ego.progress_m - tenth_m * np.arange(10), 0.0, tenth_m) / 1000
        for one in ego.infractions:
            counts[min(9, max(0, int(one.route_m / tenth_m)))] += 1
    return [float(count / driven) if driven >= 0.1 else None for count, driven in zip(counts, km, strict=True)]


def _shifts(n: int) -> FloatArray:
    """(n,) offsets within a row of height 1, so that the marks of n agents do not overlap."""
    return (np.arange(n, dtype=np.float64) - (n - 1) / 2) * min(0.22, 0.7 / max(n, 1))


def _reach(end: float | None, mean: float) -> float:
    """Distance from the mean to one end of an interval; 0 if there is no interval."""
    return 0.0 if end is None else abs(end - mean)


def _entitle(figure: go.Figure, finding: str, caption: str) -> None:
    figure.update_layout(template=template(), title={"text": finding, "subtitle": {"text": caption}})
