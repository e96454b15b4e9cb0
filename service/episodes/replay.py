"""Replay: data for the player, built from an episode's record, trajectory and network."""

from __future__ import annotations

import gzip
from collections.abc import Iterator
from typing import Any, Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from dohyo.evaluation.records.record import EgoRecord, EpisodeRecord, Infraction
from dohyo.evaluation.records.roads import check_roads
from dohyo.evaluation.records.trajectory import Trajectory
from dohyo.evaluation.scores.driving import Rules, infraction_penalty, outside_fraction
from dohyo.evaluation.summary import score_drive
from dohyo.sumo_networks.arrays import FloatArray, IntArray
from dohyo.sumo_networks.networks.network import RoadNetwork
from dohyo.sumo_networks.routes.routing import plan_route
from dohyo.sumo_networks.world import ActorKind

FORMAT: Final = 2
"""Version of the format, part of the cache key; increases with every change."""
DT_S: Final = 0.1
MARGIN_M: Final = 40.0
_GZIP_LEVEL: Final = 4  # level 6 takes four times as long and saves a twentieth
_SERIES: Final = {"speed": 2, "acceleration": 2, "steering": 3, "progress": 2, "lateral": 2}


def replay_of(
    record: EpisodeRecord, trajectory: Trajectory, network: RoadNetwork, *, episode: str, rules: Rules
) -> dict[str, Any]:
    """Data for the player except the roads; plain JSON, metres and radians to two decimals, network frame.

    Args:
        record: Record of the episode.
        trajectory: Trajectories of the same episode.
        network: Network of the episode.
        episode: Identifier of the episode at the service.
        rules: Rules of the driving score.

    Returns:
        `egos` with their routes, infractions and series; `actors`, an entry per gap-free appearance of whatever moved,
        the egos included (kind "ego"); `signals` near them, each with its stop line and its changes.

    Raises:
        InvalidInputError: The network differs from the record's, or a mission cannot be planned on it.
    """
    check_roads(record, network)
    routes = [plan_route(network, mission).position for mission in record.scenario.missions]
    bounds = _bounds(trajectory, routes)
    return {
        "episode": episode,
        "scenario": record.scenario.name,
        "network": record.scenario.network,
        "rules": rules,
        "dt_s": DT_S,
        "ticks": int(trajectory.tick.max(initial=-1)) + 1,
        "bounds": bounds,
        "egos": [
            _ego(ego, index, route, trajectory, rules)
            for index, (ego, route) in enumerate(zip(record.egos, routes, strict=True))
        ],
        "actors": list(_appearances(trajectory)),
        "signals": list(_signals(trajectory.signals, network, bounds)),
    }


def encode(replay: dict[str, Any]) -> bytes:
    """The replay as gzipped JSON; equal replays give equal bytes."""
    return gzip.compress(msgspec.json.encode(replay), _GZIP_LEVEL, mtime=0)


def infraction_document(one: Infraction, rules: Rules) -> dict[str, Any]:
    """An infraction as plain JSON, with its `unit` and `factor`, the penalty of a drive with only this infraction."""
    return one.model_dump(mode="json") | {"unit": one.unit, "factor": infraction_penalty([one], rules, 0.0)}


def _bounds(trajectory: Trajectory, routes: list[FloatArray]) -> list[float]:
    """Bounding box x0, y0, x1, y1 of all drawn objects, m."""
    moved = np.column_stack([trajectory.x, trajectory.y]).astype(np.float64)
    points = np.concatenate([moved[np.isfinite(moved).all(axis=1)], *routes])
    low, high = points.min(axis=0) - MARGIN_M, points.max(axis=0) + MARGIN_M
    return _rounded(np.array([*low, *high]), 2)


def _ego(ego: EgoRecord, index: int, route: FloatArray, trajectory: Trajectory, rules: Rules) -> dict[str, Any]:
    rows = np.flatnonzero(trajectory.key == -1 - index)
    first = rows[:1]
    scores = score_drive(ego, rules=rules)
    return {
        "name": ego.name,
        "length": _rounded(trajectory.length[first], 2)[0] if len(first) else 0.0,
        "width": _rounded(trajectory.width[first], 2)[0] if len(first) else 0.0,
        "route": np.round(route, 2).tolist(),
        "status": ego.status.value,
        "failure": ego.failure,
        "infractions": [infraction_document(one, rules) for one in ego.infractions],
        "series": {name: _rounded(getattr(trajectory, name)[rows], digits) for name, digits in _SERIES.items()},
        "score": {
            "rc": scores["route_completion"],
            "ip": scores["infraction_penalty"],
            "ds": scores["driving_score"],
            "irs": scores["irs"],
            "outside": outside_fraction(ego),
            "factors": [[one.kind.value, infraction_penalty([one], rules, 0.0)] for one in ego.infractions],
        },
    }


def _appearances(trajectory: Trajectory) -> Iterator[dict[str, Any]]:
    """Sorted by key, then time; an actor that leaves the world and returns has several."""
    order = np.lexsort((trajectory.tick, trajectory.key))
    tick, key = trajectory.tick[order], trajectory.key[order]
    new = (np.diff(key) != 0) | (np.diff(tick) != 1)
    starts = np.concatenate([[0], np.flatnonzero(new) + 1, [len(order)]]) if len(order) else np.zeros(1, dtype=int)
    columns = {name: _rounded(getattr(trajectory, name)[order], 2) for name in ("x", "y", "heading", "speed")}
    sizes = {name: _rounded(getattr(trajectory, name)[order], 2) for name in ("length", "width")}
    kinds = trajectory.kind[order]
    for start, stop in zip(starts[:-1].tolist(), starts[1:].tolist(), strict=True):
        yield {
            "key": int(key[start]),
            "name": trajectory.names[int(key[start])],
            "kind": ActorKind(int(kinds[start])).name.lower(),
            "first": int(tick[start]),
            **{name: values[start] for name, values in sizes.items()},
            **{name: values[start:stop] for name, values in columns.items()},
        }


def _signals(changes: NDArray[np.int32], network: RoadNetwork, bounds: list[float]) -> Iterator[dict[str, Any]]:
    """Stop lines within the bounds; signals of one line that always agree are one, the others follow right to left."""
    history: dict[int, list[list[int]]] = {}
    for tick, signal, state in changes[np.argsort(changes[:, 0], kind="stable")].tolist():
        history.setdefault(signal, []).append([tick, state])
    for row in np.flatnonzero(network.stop_lines.lit).tolist():
        line: FloatArray = network.stop_lines.segment[row]
        if not (bounds[0] <= line[0] <= bounds[2] and bounds[1] <= line[1] <= bounds[3]):
            continue
        signals: IntArray = network.connections.signal[
            np.array(network.connections_from(int(network.stop_lines.lane[row])), dtype=np.int64)
        ]
        seen = [history[int(signal)] for signal in signals if int(signal) in history]
        for place, one in enumerate(seen):
            if one not in seen[:place]:
                yield {"line": np.round(line, 2).tolist(), "changes": one}


def _rounded(values: NDArray[Any], digits: int) -> list[float]:
    """Rounded values as float64, which print as short decimals; NaN stays and becomes null in JSON."""
    rounded: list[float] = np.round(values.astype(np.float64), digits).tolist()
    return rounded
