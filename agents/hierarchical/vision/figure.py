"""Figure: semantic pictures beside their reconstructions and predictions."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from dohyo.agents.hierarchical.state.nearby import EVENT_M, IMPACT_M
from dohyo.agents.hierarchical.vision.classes import Seen
from dohyo.agents.hierarchical.vision.dataset import Pictures
from dohyo.agents.hierarchical.vision.network import Autoencoder
from dohyo.agents.hierarchical.vision.train import Batch

SAND, INK, QUIET = "#FAF8F4", "#1F2328", "#6B7280"
COLOURS = {
    Seen.NONE: (250, 248, 244),
    Seen.TERRAIN: (196, 206, 170),
    Seen.ROAD: (92, 96, 104),
    Seen.MARKING: (236, 236, 228),
    Seen.CROSSING: (190, 190, 198),
    Seen.SIDEWALK: (212, 200, 180),
    Seen.BUILDING: (168, 152, 196),
    Seen.STOP_SIGN: (176, 24, 90),
    Seen.VEHICLE: (0, 114, 178),
    Seen.BICYCLE: (86, 180, 233),
    Seen.PEDESTRIAN: (230, 159, 0),
    Seen.OBSTACLE: (213, 94, 0),
    Seen.RED: (220, 40, 36),
    Seen.YELLOW: (240, 200, 40),
    Seen.GREEN: (0, 158, 115),
}
SIGNALS = ("no light", "red", "yellow", "green")
TITLES = {"validation": "town of training, other drives", "test": "a town never seen"}
SCALE, GAP, TEXT = 2, 12, 18
PER_SPLIT = 4


def draw(network: Autoencoder, splits: Mapping[str, Pictures], path: Path) -> None:
    """Writes a PNG: a column per picture, of each split those with the most content, originals on top.

    Args:
        network: Trained.
        splits: Pictures by a name of `TITLES`.
        path: Of the PNG.
    """
    columns = [(split, int(row)) for split, pictures in splits.items() for row in chosen(pictures)]
    height, width = (SCALE * side for side in next(iter(splits.values())).pictures.shape[1:])
    per_row, block = PER_SPLIT, 2 * (height + TEXT) + 2 * GAP + TEXT
    size = (GAP + per_row * (width + GAP), GAP + block * len(splits) + 3 * TEXT)
    sheet, regular, bold = Image.new("RGB", size, SAND), _font(13), _font(14, bold=True)
    pen = ImageDraw.Draw(sheet)
    for place, (split, row) in enumerate(columns):
        left, top = GAP + place % per_row * (width + GAP), GAP + place // per_row * block
        if place % per_row == 0:
            pen.text((left, top), f"{TITLES[split]}: pictures, and what became of them", INK, bold)
        rebuilt, said, batch = _rebuilt(network, splits[split], row)
        for line, (classes, text) in enumerate(
            ((batch.classes[0].numpy(), _told(batch.distances[0].numpy(), int(batch.signal[0]))), (rebuilt, said))
        ):
            down = top + TEXT + line * (height + TEXT + 4)
            sheet.paste(_coloured(classes), (left, down))
            pen.text((left, down + height + 1), text, QUIET, regular)
    _legend(pen, regular, size[1] - 2 * TEXT)
    path.parent.mkdir(parents=True, exist_ok=True)
    sheet.save(path, optimize=True)


def chosen(pictures: Pictures) -> list[int]:
    """Of each quarter the picture with the most other actors, and a light."""
    seen = Batch.of(pictures).classes.numpy()
    weight = {Seen.VEHICLE: 1.0, Seen.PEDESTRIAN: 3.0, Seen.BICYCLE: 3.0, Seen.RED: 10.0, Seen.GREEN: 10.0}
    interest = sum(w * np.minimum((seen == c).sum(axis=(1, 2)), 800) for c, w in weight.items())
    parts = np.array_split(np.asarray(interest), PER_SPLIT)
    starts = np.cumsum([0, *(len(part) for part in parts[:-1])])
    return [int(start + part.argmax()) for start, part in zip(starts, parts, strict=True) if len(part)]


def _rebuilt(network: Autoencoder, pictures: Pictures, row: int) -> tuple[NDArray[Any], str, Batch]:
    batch = Batch.of(pictures).rows(torch.tensor([row]))
    with torch.no_grad():
        mean, _ = network.encode(batch.planes)
        classes = network.decode(mean).argmax(dim=1)[0].numpy()
        said = network.encoder.tell(mean)[0].numpy()
    return classes, _told(np.clip(said[:2], 0.0, 1.0), int(said[2:].argmax())), batch


def _told(distances: NDArray[Any], signal: int) -> str:
    impact, event = (share * unit for share, unit in zip(distances.tolist(), (IMPACT_M, EVENT_M), strict=True))
    return f"impact in {impact:.0f} m, event in {event:.0f} m, {SIGNALS[signal]}"


def _coloured(classes: NDArray[Any]) -> Image.Image:
    palette = np.array([COLOURS[one] for one in Seen], dtype=np.uint8)
    large = np.kron(palette[classes], np.ones((SCALE, SCALE, 1), dtype=np.uint8))
    return Image.fromarray(large)


def _legend(pen: ImageDraw.ImageDraw, font: ImageFont.FreeTypeFont, top: int) -> None:
    left = GAP
    for one in Seen:
        name = one.name.lower().replace("_", " ")
        pen.rectangle((left, top + 2, left + 12, top + 14), COLOURS[one], QUIET)
        pen.text((left + 17, top), name, INK, font)
        left += 17 + int(pen.textlength(name, font)) + 14


def _font(size: int, bold: bool = False) -> ImageFont.FreeTypeFont:
    font = ImageFont.load_default(size)
    assert isinstance(font, ImageFont.FreeTypeFont)
    return font
