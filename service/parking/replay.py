"""Replay of a lot: data for the player, built from the record and the motion; the lot is drawn again from its seed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from dohyo.evaluation.parking.benchmark import scene_of
from dohyo.evaluation.parking.record import KartRecord, ParkingRecord
from dohyo.evaluation.records.specifications import InfractionKind
from dohyo.service.evaluations.scoring import STATUSES
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
_CONTACTS: Final[Mapping[str, str]] = {
    "wall": InfractionKind.COLLISION_STATIC.value,
    "car": InfractionKind.COLLISION_VEHICLE.value,
    "kart": InfractionKind.COLLISION_VEHICLE.value,
    "pedestrian": InfractionKind.COLLISION_PEDESTRIAN.value,
}
"""Mark of a contact in the player, by what the kart touched."""


def replay_of_lot(record: ParkingRecord, motion: Float32Array, *, episode: str) -> dict[str, Any]:
    """Data for the player, in the form of `dohyo.service.episodes.replay`; metres and radians, frame of the lot.

    Args:
        record: Record of the episode.
        motion: Motion of the same episode, see `dohyo.evaluation.parking.drive.Drive`.
        episode: Identifier of the episode at the service.

    Returns:
        `lot`: what stands there, in place of roads: walls as both ends, boxes and spots as centre, heading, length and
        width. `egos`: the karts, each with the facts of its record, and its contact as an infraction. `actors`: karts
        and pedestrians tick by tick.
    """
    world = ParkingWorld(1, len(record.karts))
    world.draw([0], [record.seed], scene_of(record.benchmark.scene), JUDGED)
    view, karts = world.view(0), len(record.karts)
    return {
        "kind": "parking",
        "episode": episode,
        "scenario": record.scenario.name,
        "network": None,
        "rules": None,
        "dt_s": kart.TICK_S,
        "ticks": len(motion),
        "bounds": _bounds(view, motion),
        "lot": _standing(view),
        "egos": [_kart(one, number, motion[:, number]) for number, one in enumerate(record.karts)],
        "actors": [
            *(_track(f"kart-{k}", "ego", motion[:, k], kart.LENGTH_M, kart.WIDTH_M) for k in range(karts)),
            *(
                _track(f"pedestrian-{k}", "pedestrian", motion[:, karts + k], *[2.0 * walker[WALK_RADIUS]] * 2)
                for k, walker in enumerate(view.walkers)
            ),
        ],
        "signals": [],
    }


def _standing(view: LotView) -> dict[str, Any]:
    return {
        "walls": _rounded(view.walls),
        "blocks": _rounded(view.boxes[view.boxes[:, KIND] == Kind.WALL, _BOX]),
        "cars": _rounded(view.boxes[view.boxes[:, KIND] == Kind.CAR, _BOX]),
        "spots": [{"box": _rounded(spot[_BOX]), "free": bool(spot[FREE])} for spot in view.spots],
        "walks": _rounded(view.walkers[:, :4]),
    }


def _kart(one: KartRecord, number: int, motion: Float32Array) -> dict[str, Any]:
    ended = min(round(one.time_s / kart.TICK_S), len(motion) - 1)
    contact = {
        "kind": _CONTACTS.get(one.touched),
        "time_s": round(ended * kart.TICK_S, 3),
        **dict(zip(("x_m", "y_m"), _rounded(motion[ended, :2]), strict=True)),
        # The tick that ends an episode leaves the kart at rest.
        "magnitude": round(abs(float(motion[max(ended - 1, 0), 3])), 2),
        "unit": "m/s",
        "actor": one.touched,
    }
    return {
        "name": f"kart-{number}",
        "length": kart.LENGTH_M,
        "width": kart.WIDTH_M,
        "route": [],
        "status": STATUSES[one.ending].value,
        "failure": one.failure,
        # Another kart may hit one that has parked.
        "infractions": [contact] if one.ending == "collided" and one.touched in _CONTACTS else [],
        "series": {"speed": _rounded(motion[:, 3])},
        "parking": one.model_dump(mode="json"),
    }


def _track(name: str, kind: str, motion: Float32Array, length_m: float, width_m: float) -> dict[str, Any]:
    columns = dict(zip(("x", "y", "heading", "speed"), _rounded(motion.T), strict=True))
    return {"name": name, "kind": kind, "first": 0, "length": float(length_m), "width": float(width_m), **columns}


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
