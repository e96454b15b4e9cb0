"""Evaluation of a trained encoder, head by head, on held-out drives: in the town of training and in one never seen.

    python -m dohyo.agents.gri.vision.evaluate --data data/affordances --run out/vision/affordances

Writes results/affordances.json, and the table of RESULTS.md from it. Each measure stands beside that of a constant
answer: the majority of the training moments, or their median.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray

from dohyo.agents.gri.vision.labels import LIGHT_M
from dohyo.agents.gri.vision.moments import Moments
from dohyo.agents.gri.vision.network import VisualSystem
from dohyo.agents.gri.vision.recording import JUDGED
from dohyo.agents.gri.vision.tables import PAGE, SECTION, table
from dohyo.agents.gri.vision.train import WHOLE, load_system
from dohyo.agents.hierarchical.vision.classes import Seen
from dohyo.agents.hierarchical.vision.evaluate import confusion, intersection_over_union
from dohyo.agents.perception.drives import Drives
from dohyo.agents.studies.tables import write_section
from dohyo.evaluation.statistics import ratio_estimate
from dohyo.sumo_networks.arrays import BoolArray, IntArray
from dohyo.sumo_networks.files import write_atomically

STORED: Final = Path(__file__).with_name("results") / "affordances.json"
BATCH: Final = 64


class Answers(NamedTuple):
    """Answers to N moments, and the true ones have the same form.

    Attributes:
        junction: (N,) 0 or 1.
        lit: (N,) 0 or 1.
        colour: (N,) 0 to 2; means nothing without a light.
        distance_m: (N,) m; means nothing without a light.
        angle_rad: (N,) rad.
        offset_m: (N,) m.
    """

    junction: NDArray[Any]
    lit: NDArray[Any]
    colour: NDArray[Any]
    distance_m: NDArray[Any]
    angle_rad: NDArray[Any]
    offset_m: NDArray[Any]


def true_answers(moments: Moments) -> Answers:
    """What is so."""
    light = moments.light.numpy()
    numbers = moments.distance_m.numpy(), moments.angle_rad.numpy(), moments.offset_m.numpy()
    return Answers(moments.junction.numpy(), (light > 0).astype(np.int64), np.maximum(light - 1, 0), *numbers)


def constant_answers(training: Answers) -> dict[str, float]:
    """The best answer without looking, by head: the majority, or the median, which has the smallest mean error."""
    lit = training.lit == 1

    def majority(values: NDArray[Any]) -> float:
        return float(np.bincount(values).argmax())

    return {
        "junction": majority(training.junction),
        "lit": majority(training.lit),
        "colour": majority(training.colour[lit]),
        "distance_m": float(np.median(training.distance_m[lit])),
        "angle_rad": float(np.median(training.angle_rad)),
        "offset_m": float(np.median(training.offset_m)),
    }


def judged(told: Answers, true: Answers, constant: Mapping[str, float], drive: IntArray) -> dict[str, Any]:
    """Accuracies [0 to 1] and mean errors of the heads, and those of constant answers.

    Args:
        told: Answers of the heads.
        true: What is so.
        constant: See `constant_answers`.
        drive: (N,) number of the drive of each moment; intervals are over drives.

    Returns:
        By head: "moments", "value" with its 95 % interval, "constant"; None where there is nothing to judge.
    """
    out: dict[str, Any] = {}
    for name, mine, right in zip(Answers._fields, told, true, strict=True):
        counts = np.ones(len(drive), bool) if name not in ("colour", "distance_m") else true.lit == 1
        if not counts.any():
            out[name] = None
            continue
        numeric = name in ("distance_m", "angle_rad", "offset_m")
        scored = np.abs(mine - right) if numeric else np.equal(mine, right)
        flat = np.abs(constant[name] - right) if numeric else np.equal(constant[name], right)
        out[name] = {
            "moments": int(counts.sum()),
            "value": _over_drives(scored[counts], drive[counts]),
            "constant": round(float(flat[counts].mean()), 4),
        }
    return out


def _over_drives(values: NDArray[Any], drive: IntArray) -> list[float | None]:
    """Mean over moments, and its 95 % interval by bootstrap over drives."""
    names = np.unique(drive)
    sums = [float(values[drive == one].sum()) for one in names]
    found = ratio_estimate(sums, [float((drive == one).sum()) for one in names], floor=1.0)
    return [None if one is None else round(float(one), 4) for one in (found.mean, found.low, found.high)]


def answers_of(network: VisualSystem, moments: Moments) -> tuple[Answers, NDArray[np.int64]]:
    """Answers of the heads, and (15, 15) pixels by true class (row) and told class (column)."""
    counts = np.zeros((len(Seen), len(Seen)), dtype=np.int64)
    told: list[tuple[NDArray[Any], ...]] = []
    with torch.inference_mode():
        for part in torch.split(torch.arange(len(moments)), BATCH):
            batch = moments.rows(part)
            classes = network.segment(batch.pictures.flatten(0, 1)).argmax(dim=1)
            counts += confusion(classes.numpy(), batch.classes.flatten(0, 1).numpy())
            heads = network.predict(batch.pictures)
            kinds = (one.argmax(dim=1).numpy() for one in (heads.road, heads.light, heads.colour))
            distance = heads.distance.clamp(0.0, 1.0).numpy() * LIGHT_M
            told.append((*kinds, distance, heads.angle.numpy(), heads.offset.numpy()))
    return Answers(*(np.concatenate(column) for column in zip(*told, strict=True))), counts


def judged_split(network: VisualSystem, drives: Drives, constant: Mapping[str, float]) -> dict[str, Any]:
    """Segmentation of all pictures; heads with the cameras as an agent has them, and displaced."""
    moments = Moments.of(drives)
    told, counts = answers_of(network, moments)
    true, drive = true_answers(moments), np.repeat(np.arange(len(drives.drives)), np.diff(drives.starts))
    mounted = (moments.displacement == 0.0).all(dim=1).numpy()
    iou, share = intersection_over_union(counts), counts.sum(axis=1) / counts.sum()
    return {
        "drives": len(drives.drives),
        "moments": len(moments),
        "pixels_right": round(float(np.diag(counts).sum() / counts.sum()), 4),
        "majority_share": round(float(share.max()), 4),
        "iou": {Seen(i).name.lower(): None if np.isnan(v) else round(float(v), 4) for i, v in enumerate(iou)},
        "share": {Seen(i).name.lower(): round(float(v), 6) for i, v in enumerate(share)},
        "mounted": judged(_those(told, mounted), _those(true, mounted), constant, drive[mounted]),
        "displaced": judged(_those(told, ~mounted), _those(true, ~mounted), constant, drive[~mounted]),
    }


def _those(answers: Answers, chosen: BoolArray) -> Answers:
    return Answers(*(one[chosen] for one in answers))


def main() -> None:
    """See the module."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, required=True, help="data set of `dohyo dataset affordances`")
    parser.add_argument("--run", type=Path, required=True, help="folder of `dohyo train affordances`")
    parser.add_argument("--out", type=Path, default=STORED, help="JSON file to be written")
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    network, training = load_system(arguments.run / WHOLE), Moments.load(arguments.data, "train")
    constant = constant_answers(true_answers(training))
    splits = {name: judged_split(network, Drives(arguments.data, name), constant) for name in JUDGED}
    document = {"training_moments": len(training), "constant": constant, "splits": splits}
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    write_atomically(arguments.out, (json.dumps(document, indent=1) + "\n").encode())
    if arguments.out == STORED:
        write_section(PAGE, SECTION, table(document))


if __name__ == "__main__":
    main()
