"""Hand-made moments: a picture shows its labels in plain colours."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from dohyo.agents.gri.vision.cameras import CENTRE
from dohyo.agents.gri.vision.labels import LIGHT_M
from dohyo.agents.hierarchical.vision.classes import Seen
from dohyo.agents.perception.drives import write_drives

COLOURS = ((255, 0, 0), (255, 200, 0), (0, 255, 0))
"""Of lights."""


def moments(count: int, seed: int) -> dict[str, np.ndarray]:
    """Columns of a drive. A junction is a white ground, a light a square that is larger when near, an angle a post,
    an offset a second one below it."""
    rng = np.random.default_rng(seed)
    pictures = np.full((count, 3, 3, 64, 64), 60, np.uint8)
    classes = np.full((count, 3, 64, 64), Seen.ROAD, np.uint8)
    light, junction = rng.integers(0, 4, count), rng.integers(0, 2, count).astype(bool)
    distance = np.where(light > 0, rng.uniform(0.0, LIGHT_M, count), 0.0).astype(np.float32)
    angle = rng.uniform(-0.2, 0.2, count).astype(np.float32)
    offset = rng.uniform(-1.0, 1.0, count).astype(np.float32)
    for row in range(count):
        side = rng.integers(3)
        pictures[row, side, 2, :16], classes[row, side, :16] = 200, Seen.BUILDING
        centre = pictures[row, CENTRE]
        centre[:, 48:] = 255 if junction[row] else 0
        post = 32 + round(100 * float(angle[row]))
        centre[:, 32:48, post - 2 : post + 2] = 255
        post = 32 + round(20 * float(offset[row]))
        centre[:, 52:60, post - 2 : post + 2] = 128
        if light[row]:
            half = 2 + round(8 * (1.0 - float(distance[row]) / LIGHT_M))
            colour = np.array(COLOURS[light[row] - 1], np.uint8)[:, None, None]
            centre[:, 16 - half : 16 + half, 32 - half : 32 + half] = colour
    displacement = np.zeros((count, 6), np.float32)
    displacement[::2, 3] = 5.0
    return {
        "pictures": pictures, "classes": classes, "displacement": displacement, "junction": junction, "light": light,
        "distance_m": distance, "angle_rad": angle, "offset_m": offset,
    }  # fmt: skip


def write_data(folder: Path, **counts: int) -> Path:
    """A data set with two drives of so many moments in each split."""
    for number, (split, count) in enumerate(counts.items()):
        drives = {f"ego{k}": (moments(count, 10 * number + k), {"seed": k}) for k in range(2)}
        (folder / split).mkdir(parents=True)
        write_drives(folder / split / "hand-made", drives)
    return folder
