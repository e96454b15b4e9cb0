"""Evaluation of an autoencoder: reconstruction by class, and predictions from its latents, on held-out pictures.

    python -m dohyo.agents.hierarchical.vision.evaluate --data data/semantic --run runs/semantic

Writes results/vision.json, and results/vision.png: pictures beside their reconstructions. "validation" is other drives
in the town of training, "test" an unseen town.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from dohyo.agents.hierarchical.state.nearby import EVENT_M, IMPACT_M
from dohyo.agents.hierarchical.vision.classes import CLASSES, Seen
from dohyo.agents.hierarchical.vision.dataset import Pictures, load_split
from dohyo.agents.hierarchical.vision.figure import draw
from dohyo.agents.hierarchical.vision.network import Autoencoder
from dohyo.agents.hierarchical.vision.train import Batch, load_autoencoder
from dohyo.sumo_networks.files import write_atomically

RESULTS = Path(__file__).parents[1] / "results"
BATCH = 32
RESAMPLES = 1000


def confusion(rebuilt: NDArray[Any], true: NDArray[Any]) -> NDArray[np.int64]:
    """(15, 15) pixels by true class (row) and reconstructed class (column)."""
    pairs = true.astype(np.int64).ravel() * CLASSES + rebuilt.astype(np.int64).ravel()
    return np.bincount(pairs, minlength=CLASSES * CLASSES).reshape(CLASSES, CLASSES)


def intersection_over_union(counts: NDArray[np.int64]) -> NDArray[np.float64]:
    """(15,) intersection over union of each class; NaN for absent ones."""
    both = np.diag(counts).astype(np.float64)
    either = counts.sum(axis=0) + counts.sum(axis=1) - np.diag(counts)
    return np.where(either > 0, both / np.maximum(either, 1), np.nan)


def judge(network: Autoencoder, pictures: Pictures, constant: NDArray[np.float64]) -> dict[str, Any]:
    """All measures of a network on one split.

    Args:
        network: Trained.
        pictures: Of the split.
        constant: (2,) constant prediction: medians of the training split's distances, m.
    """
    data, counts = Batch.of(pictures), np.zeros((CLASSES, CLASSES), dtype=np.int64)
    told: list[NDArray[Any]] = []
    with torch.no_grad():
        for part in torch.split(torch.arange(len(data)), BATCH):
            batch = data.rows(part)
            mean, _ = network.encode(batch.planes)
            counts += confusion(network.decode(mean).argmax(dim=1).numpy(), batch.classes.numpy())
            told.append(network.encoder.tell(mean).numpy())
    said, iou = np.concatenate(told), intersection_over_union(counts)
    true = np.column_stack([pictures.impact_m, pictures.event_m])
    metres = np.clip(said[:, :2], 0.0, 1.0) * (IMPACT_M, EVENT_M)
    right = said[:, 2:].argmax(axis=1) == data.signal.numpy()
    lit = data.signal.numpy() > 0
    return {
        "pictures": len(data),
        "pixels_right": float(np.diag(counts).sum() / counts.sum()),
        "iou": {Seen(i).name.lower(): None if np.isnan(v) else round(float(v), 4) for i, v in enumerate(iou)},
        "share": {Seen(i).name.lower(): float(v) for i, v in enumerate(counts.sum(axis=1) / counts.sum())},
        "impact_mae_m": mean_interval(np.abs(metres[:, 0] - true[:, 0])),
        "impact_constant_mae_m": mean_interval(np.abs(constant[0] - true[:, 0])),
        "event_mae_m": mean_interval(np.abs(metres[:, 1] - true[:, 1])),
        "event_constant_mae_m": mean_interval(np.abs(constant[1] - true[:, 1])),
        "signal_right": mean_interval(right.astype(np.float64)),
        "signal_right_where_lit": mean_interval(right[lit].astype(np.float64)) if lit.any() else None,
        "signal_most_frequent": float(np.bincount(data.signal.numpy(), minlength=4).max() / len(data)),
    }


def mean_interval(values: NDArray[np.float64]) -> list[float]:
    """Mean and its 95 % interval by bootstrap over pictures, which are not independent: too narrow."""
    rng = np.random.default_rng(0)
    means = [float(values[rng.integers(len(values), size=len(values))].mean()) for _ in range(RESAMPLES)]
    low, high = np.percentile(means, [2.5, 97.5])
    return [round(float(v), 4) for v in (values.mean(), low, high)]


def main() -> None:
    """See the module."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--run", type=Path, required=True)
    parser.add_argument("--out", type=Path, default=RESULTS)
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    network = load_autoencoder(arguments.run / "autoencoder.safetensors")
    train = load_split(arguments.data, "train")
    constant = np.array([np.median(train.impact_m), np.median(train.event_m)], dtype=np.float64)
    splits = {split: load_split(arguments.data, split) for split in ("validation", "test")}
    result = {split: judge(network, pictures, constant) for split, pictures in splits.items()}
    document = {"training_pictures": len(train), "constant_m": constant.tolist(), **result}
    arguments.out.mkdir(parents=True, exist_ok=True)
    write_atomically(arguments.out / "vision.json", (json.dumps(document, indent=1) + "\n").encode())
    draw(network, splits, arguments.out / "vision.png")


if __name__ == "__main__":
    main()
