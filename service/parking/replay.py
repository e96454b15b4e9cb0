"""Replay of a lot: data for the player, built from the record and the motion; the lot is drawn again from its seed."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from dohyo.evaluation.parking.benchmark import scene_of
from dohyo.evaluation.parking.record import ParkingRecord
from dohyo.sumo_networks.arrays import Float32Array, FloatArray
from dohyo.sumo_networks.parking import kart
from dohyo.sumo_networks.parking.radar import Kind
from dohyo.sumo_networks.parking.rows import LotView
from dohyo.sumo_networks.parking.rules import JUDGED
from dohyo.sumo_networks.parking.tables import FREE, KIND, WALK_RADIUS
from dohyo.sumo_networks.parking.world import ParkingWorld

MARGIN_M: Final = 2.0
_BOX: Final = slice(0, 5)
"""Centre, heading, length and width in the rows of boxes and spots."""


def replay_of_lot(record: ParkingRecord, motion: Float32Array, *, episode: str) -> dict[str, Any]:
    """Data for the player; plain JSON, metres and radians to three decimals, frame of the lot.

    Args:
        record: Record of the episode.
        motion: Motion of the same episode, see `dohyo.evaluation.parking.drive.Drive`.
        episode: Identifier of the episode at the service.

    Returns:
        `lot`: what stands there, walls as both ends, boxes and spots as centre, heading, length and width; `karts` and
        `pedestrians` with their places tick by tick. Each kart has the facts of its record.
    """
    world = ParkingWorld(1, len(record.karts))
    world.draw([0], [record.seed], scene_of(record.benchmark.scene), JUDGED)
    view = world.view(0)
    karts, walkers = motion[:, : len(record.karts)], motion[:, len(record.karts) :]
    return {
        "kind": "parking",
        "episode": episode,
        "scenario": record.scenario.name,
        "seed": record.seed,
        "scene": record.benchmark.scene,
        "dt_s": kart.TICK_S,
        "ticks": len(motion),
        "bounds": _bounds(view, motion),
        "lot": {
            "walls": _rounded(view.walls),
            "blocks": _rounded(view.boxes[view.boxes[:, KIND] == Kind.WALL, _BOX]),
            "cars": _rounded(view.boxes[view.boxes[:, KIND] == Kind.CAR, _BOX]),
            "spots": [{"box": _rounded(spot[_BOX]), "free": bool(spot[FREE])} for spot in view.spots],
        },
        "karts": [
            {"name": f"kart-{number}", "length": kart.LENGTH_M, "width": kart.WIDTH_M}
            | one.model_dump(mode="json")
            | dict(zip(("x", "y", "heading", "speed"), _rounded(karts[:, number].T), strict=True))
            for number, one in enumerate(record.karts)
        ],
        "pedestrians": [
            {"radius": float(walker[WALK_RADIUS]), "path": _rounded(walker[:4])}
            | dict(zip(("x", "y"), _rounded(walkers[:, number, :2].T), strict=True))
            for number, walker in enumerate(view.walkers)
        ],
    }


def _bounds(view: LotView, motion: Float32Array) -> list[float]:
    """Bounding box x0, y0, x1, y1 of all drawn objects."""
    driven = motion[..., :2].reshape(-1, 2).astype(np.float64)
    ends = view.walls.reshape(-1, 2)
    reach = [_corners_of(boxes) for boxes in (view.boxes, view.spots)]
    points = np.concatenate([ends, *reach, driven])
    return list(_rounded(np.array([*points.min(axis=0) - MARGIN_M, *points.max(axis=0) + MARGIN_M])))


def _corners_of(boxes: FloatArray) -> FloatArray:
    """Corners of squares around boxes, whatever their headings."""
    half = 0.5 * np.hypot(boxes[:, 3], boxes[:, 4])[:, None]
    return np.concatenate([boxes[:, :2] - half, boxes[:, :2] + half])


def _rounded(values: NDArray[Any]) -> list[Any]:
    """Rounded values as float64, which print as short decimals."""
    rounded: list[Any] = np.round(values.astype(np.float64), 3).tolist()
    return rounded
