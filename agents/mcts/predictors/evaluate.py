"""Evaluation of the predictors on held-out networks.

    python -m dohyo.agents.mcts.predictors.evaluate --data FOLDER [--split test] [--out results.json]

It covers the ego and its nearest 30 actors, if they were seen for the whole 8 s. Scenes of one episode resemble
each other, so the unit of every mean, interval and comparison is the episode: its mean is one value.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dohyo.agents.mcts.predictors.constant_velocity import ConstantVelocity
from dohyo.agents.mcts.predictors.dataset import FUTURE_STEP_S, Sample, load_shard, shards_of
from dohyo.agents.mcts.predictors.idm import IdmRollout
from dohyo.agents.mcts.predictors.learned import SHIPPED, Learned
from dohyo.agents.planning.prediction import NEAREST, STEP_S, Forecast, Predictor
from dohyo.evaluation.statistics import mean_estimate, paired
from dohyo.sumo_networks.arrays import BoolArray, FloatArray, IntArray
from dohyo.sumo_networks.errors import DohyoError
from dohyo.sumo_networks.files import write_atomically
from dohyo.sumo_networks.geometry import wrap_angle
from dohyo.sumo_networks.world import ActorKind

HORIZONS_S = (1.0, 3.0, 8.0)
MISS_M = 4.0
"""Displacement after 8 s above which a prediction is a miss, m."""
STOOD_MPS, STOOD_M, TURNED = 0.5, 2.0, 0.5
"""Standing now; standing for 8 s; turning within them, rad."""
PREDICTORS: Mapping[str, Callable[[Path], Predictor]] = MappingProxyType(
    {
        "constant velocity": lambda path: ConstantVelocity(),
        "CTRA": lambda path: ConstantVelocity("ctra"),
        "IDM": lambda path: IdmRollout(),
        "learned": lambda path: Learned(path),
    }
)
_STRIDE = round(FUTURE_STEP_S / STEP_S)
_PEOPLE = (int(ActorKind.PEDESTRIAN), int(ActorKind.BICYCLE))


@dataclass(frozen=True, slots=True)
class Errors:
    """Errors of one predictor, a row per agent and scene, R in all.

    Attributes:
        distance: (R, 16), m, displacement in 0.5, 1.0, ..., 8 s.
        episode: (R,) index of the shard.
        kind: (R,) `world.ActorKind`; EGO for the driven vehicle.
        speed: (R,), m/s, at present.
        moved: (R,), m, distance moved after 8 s.
        turned: (R,), rad, change of heading by then.
        milliseconds: (C,) processor time of every call.
    """

    distance: FloatArray
    episode: IntArray
    kind: IntArray
    speed: FloatArray
    moved: FloatArray
    turned: FloatArray
    milliseconds: FloatArray


def errors_of(predictor: Predictor, shards: list[Path], stride: int = 1) -> Errors:
    """Predicts every stride-th sample of some shards."""
    tables: list[list[FloatArray]] = []
    times = []
    for episode, path in enumerate(shards):
        shard = load_shard(path)
        for number in range(0, len(shard), stride):
            sample = shard[number]
            began = time.thread_time()
            forecast = predictor.predict(sample.scene)
            times.append((time.thread_time() - began) * 1000.0)
            tables.append([*_compared(sample, forecast), episode])  # type: ignore[list-item]
    sizes = [len(table[0]) for table in tables]
    columns = [np.concatenate([table[i] for table in tables]) for i in range(5)]
    return Errors(
        distance=columns[0],
        episode=np.repeat(np.array([table[5] for table in tables], dtype=np.int64), sizes),
        kind=columns[1].astype(np.int64),
        speed=columns[2],
        moved=columns[3],
        turned=columns[4],
        milliseconds=np.array(times),
    )


def _compared(sample: Sample, forecast: Forecast) -> list[FloatArray]:
    """Distance, kind, speed, way and turn of the agents of one scene; the ego first, if it counts."""
    actors, near = sample.scene.actors, min(len(sample.scene.actors), NEAREST)
    now = np.column_stack([actors.position, actors.heading])[:near]
    future, told = sample.actors_future[:near].astype(np.float64), forecast.actors[:near]
    kind, speed = actors.kind[:near].astype(np.float64), actors.speed[:near]
    seen = np.array([valid.all() for valid in sample.actors_future_valid[:near]], dtype=np.bool_)
    if forecast.ego is not None:
        now = np.concatenate([np.zeros((1, 3)), now])
        future = np.concatenate([sample.ego_future[None].astype(np.float64), future])
        told = np.concatenate([forecast.ego[None], told])
        kind = np.concatenate([[float(ActorKind.EGO)], np.where(kind == ActorKind.EGO, float(ActorKind.CAR), kind)])
        speed = np.concatenate([[sample.scene.ego.speed], speed])
        seen = np.concatenate([[bool(sample.ego_future_valid.all())], seen])
    off = np.hypot(*(told[:, _STRIDE::_STRIDE, :2] - future[:, :, :2]).transpose(2, 0, 1))
    moved = np.hypot(*(future[:, -1, :2] - now[:, :2]).T)
    turned = np.abs(wrap_angle(future[:, -1, 2] - now[:, 2]))
    return [column[seen] for column in (off, kind, speed, moved, turned)]


def measures(errors: Errors) -> dict[str, list[float]]:
    """Every measure, one value per episode that has rows for it: ADE and FDE [m], misses [%]."""
    ego, walks = errors.kind == ActorKind.EGO, np.isin(errors.kind, _PEOPLE)
    moves = errors.moved > STOOD_M
    groups = {
        "neighbours": ~ego,
        "vehicles that move": ~ego & ~walks & moves,
        "bicycles": errors.kind == ActorKind.BICYCLE,
        "pedestrians": errors.kind == ActorKind.PEDESTRIAN,
        "ego": ego,
    }
    out = {}
    for name, rows in groups.items():
        for horizon in HORIZONS_S:
            upto = round(horizon / FUTURE_STEP_S)
            out[f"{name}: ADE at {horizon:g} s"] = _by_episode(errors, errors.distance[:, :upto].mean(axis=1), rows)
            out[f"{name}: FDE at {horizon:g} s"] = _by_episode(errors, errors.distance[:, upto - 1], rows)
        out[f"{name}: miss %"] = _by_episode(errors, 100.0 * (errors.distance[:, -1] > MISS_M), rows)
    return out


def miss_cases(errors: Errors) -> dict[str, tuple[int, float]]:
    """Behaviour of motorised neighbours: number, and share missed after 8 s, %."""
    drives = (errors.kind != ActorKind.EGO) & ~np.isin(errors.kind, _PEOPLE)
    stood, stands = errors.speed < STOOD_MPS, errors.moved < STOOD_M
    turns = errors.turned > TURNED
    cases = {
        "stays where it stands": stood & stands,
        "drives off": stood & ~stands,
        "comes to a halt, or nearly": ~stood & stands,
        "turns": ~stood & ~stands & turns,
        "drives on": ~stood & ~stands & ~turns,
    }
    missed = errors.distance[:, -1] > MISS_M
    counts = {name: int((drives & rows).sum()) for name, rows in cases.items()}
    return {
        name: (counts[name], float(100.0 * missed[drives & rows].mean()) if counts[name] else 0.0)
        for name, rows in cases.items()
    }


def report(found: Mapping[str, Errors]) -> dict[str, Any]:
    """Means with 95 % intervals over episodes, comparisons of the last predictor with the others, and miss cases."""
    values = {name: measures(errors) for name, errors in found.items()}
    last = list(found)[-1]
    return {
        "episodes": len(np.unique(found[last].episode)),
        "rows": len(found[last].episode),
        "means": {name: {key: asdict(mean_estimate(v)) for key, v in table.items()} for name, table in values.items()},
        f"{last} against": {
            name: {key: asdict(paired(values[last][key], v)) for key, v in table.items() if len(v)}
            for name, table in values.items()
            if name != last
        },
        "miss cases": {name: miss_cases(errors) for name, errors in found.items()},
        "ms per scene": {
            name: {f"p{share}": float(np.percentile(errors.milliseconds, share)) for share in (50, 99)}
            for name, errors in found.items()
        },
    }


def table(document: Mapping[str, Any]) -> list[str]:
    """The report as a Markdown table, a row per measure."""
    names = list(document["means"])
    lines = ["| | " + " | ".join(names) + " |", "|---|" + "---|" * len(names)]
    for key in document["means"][names[0]]:
        cells = [_cell(document["means"][name][key]) for name in names]
        lines.append(f"| {key} | " + " | ".join(cells) + " |")
    for share in ("p50", "p99"):
        cells = [f"{document['ms per scene'][name][share]:.2f}" for name in names]
        lines.append(f"| ms of processor time per scene, {share} | " + " | ".join(cells) + " |")
    lines += ["", "| what a vehicle did | times | " + " | ".join(f"{n}: missed %" for n in names) + " |"]
    lines.append("|---|---|" + "---|" * len(names))
    for case, (count, _) in document["miss cases"][names[0]].items():
        shares = [f"{document['miss cases'][name][case][1]:.0f}" for name in names]
        lines.append(f"| {case} | {count} | " + " | ".join(shares) + " |")
    return lines


def _cell(estimate: Mapping[str, Any]) -> str:
    if estimate["mean"] is None:
        return "–"
    interval = f" [{estimate['low']:.2f}, {estimate['high']:.2f}]" if estimate["low"] is not None else ""
    return f"{estimate['mean']:.2f}{interval}"


def _by_episode(errors: Errors, value: NDArray[np.floating[Any]], rows: BoolArray) -> list[float]:
    return [float(value[rows & (errors.episode == e)].mean()) for e in np.unique(errors.episode[rows])]


def main() -> None:
    """Command-line entry point."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, required=True, help="folder of the motion dataset")
    parser.add_argument("--split", default="test")
    parser.add_argument("--predictor", type=Path, default=SHIPPED, help="ONNX model of the learned predictor")
    parser.add_argument("--stride", type=int, default=1, help="use every n-th sample")
    parser.add_argument("--out", type=Path, help="JSON file")
    arguments = parser.parse_args()
    shards = shards_of(arguments.data, arguments.split)
    found = {name: errors_of(make(arguments.predictor), shards, arguments.stride) for name, make in PREDICTORS.items()}
    document = report(found)
    if arguments.out:
        write_atomically(arguments.out, (json.dumps(document, indent=1) + "\n").encode())
    print("\n".join(table(document)))


if __name__ == "__main__":
    try:
        main()
    except DohyoError as error:
        sys.exit(f"evaluate: {error}")
