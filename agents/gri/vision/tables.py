"""Table of an evaluated encoder: a row per measure, a column per town and conditions."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from dohyo.evaluation.report.style import MISSING, markdown

PAGE: Final = Path(__file__).with_name("RESULTS.md")
SECTION: Final = "encoder"
HEADS: Final[Mapping[str, tuple[str, float, int]]] = {
    "junction": ("junction ahead, % right", 100.0, 1),
    "lit": ("light ahead, % right", 100.0, 1),
    "colour": ("its colour, % right", 100.0, 1),
    "distance_m": ("distance to it, mean error, m", 1.0, 1),
    "angle_rad": ("angle to the lane, mean error, rad", 1.0, 3),
    "offset_m": ("distance from its middle, mean error, m", 1.0, 2),
}
"""Words, scale and decimals of each head."""
KINDS: Final = {"mounted": "cameras as mounted", "displaced": "cameras displaced"}
TITLES: Final = {
    "town-train": "town-train, its conditions",
    "town-train-test-conditions": "town-train, other conditions",
    "town-test": "town-test, conditions of training",
    "town-test-test-conditions": "town-test, other conditions",
}


def table(document: Mapping[str, Any]) -> str:
    """Heads with intervals, and in parentheses a constant answer; then the segmentation by class.

    Args:
        document: What `evaluate` stores.
    """
    splits = [document["splits"][name] for name in TITLES]
    lines = [
        [f"{words}, {told}", *(_head(split[kind][name], scale, digits) for split in splits)]
        for kind, told in KINDS.items()
        for name, (words, scale, digits) in HEADS.items()
    ]
    lines.append(["pixels, % right", *(_against(100 * s["pixels_right"], 100 * s["majority_share"]) for s in splits)])
    names = splits[0]["iou"]
    lines += [[f"IoU of {name.replace('_', ' ')}, %", *(_iou(split, name) for split in splits)] for name in names]
    lines.append(["drives, moments", *(f"{split['drives']}, {split['moments']:,}" for split in splits)])
    return markdown(["", *TITLES.values()], lines)


def _head(found: Mapping[str, Any] | None, scale: float, digits: int) -> str:
    """Value with its interval, and the constant answer's."""
    if found is None:
        return MISSING
    mean, low, high = (MISSING if one is None else f"{scale * one:.{digits}f}" for one in found["value"])
    return f"{mean} [{low}, {high}] ({scale * found['constant']:.{digits}f})"


def _against(value: float, constant: float) -> str:
    return f"{value:.1f} ({constant:.1f})"


def _iou(split: Mapping[str, Any], name: str) -> str:
    value = split["iou"][name]
    return MISSING if value is None else f"{100 * value:.1f}"
