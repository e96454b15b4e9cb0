"""Overhead: what lies where in a frame, in the colours of the reports."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dohyo.sumo_networks.rendering.overhead import COLOURS, FRAME_SHAPE, METRES_PER_PX, SAND, Layer, Overhead
from dohyo.sumo_networks.world import ActorKind
from tests.worlds import Scene, straight_road


def frame(scene: Scene) -> NDArray[np.uint8]:
    world = next(iter(scene.worlds(seconds=0.1)))
    picture = Overhead().frame(world, 0)
    assert (picture.shape, picture.dtype) == (FRAME_SHAPE, np.uint8)
    return picture


def at(picture: NDArray[np.uint8], east_m: float, north_m: float) -> tuple[int, ...]:
    """Colour so far from the middle."""
    row, column = (FRAME_SHAPE[0] / 2 - north_m / METRES_PER_PX, FRAME_SHAPE[1] / 2 + east_m / METRES_PER_PX)
    return tuple(picture[int(row), int(column)].tolist())


def test_the_ego_is_in_the_middle_with_its_route_ahead_and_a_notch_in_front() -> None:
    picture = frame(straight_road().with_ego(x=50, speed=0))
    assert at(picture, 0.0, 0.0) == COLOURS[Layer.EGO]
    assert at(picture, 1.3, 0.0) == COLOURS[Layer.NOTCH]
    assert at(picture, 15.0, 0.0) == COLOURS[Layer.ROUTE]
    assert at(picture, -15.0, 0.0) == COLOURS[Layer.ROAD]
    assert at(picture, 0.0, 30.0) == SAND


def test_others_are_boxes_at_their_size_and_people_are_discs() -> None:
    scene = straight_road().with_ego(x=50, speed=0).with_actor(x=70, speed=0, length=6.0)
    picture = frame(scene.with_actor(x=40, speed=0, kind=ActorKind.PEDESTRIAN))
    assert at(picture, 20.0, 0.0) == at(picture, 17.2, 0.0) == COLOURS[Layer.VEHICLE]
    assert at(picture, 23.4, 0.0) == COLOURS[Layer.ROUTE]
    assert at(picture, -10.0, 0.0) == COLOURS[Layer.PEDESTRIAN]
