"""Hybrid A*: free paths around boxes, and none where there is none."""

from __future__ import annotations

import math

import numpy as np
import pytest

from dohyo.agents.parking.expert.expert import SHAPE
from dohyo.agents.parking.expert.hybrid_a_star import plan, touches

GOAL = np.array([0.0, 9.0, math.pi / 2])
GARAGE = np.array([[-1.5, 9.0, math.pi / 2, 5.0, 0.2], [1.5, 9.0, math.pi / 2, 5.0, 0.2], [0.0, 11.6, 0.0, 3.2, 0.2]])
BLOCK = np.array([[0.0, 3.5, 0.0, 8.0, 1.0]])


@pytest.mark.parametrize("reverse", [False, True])
def test_a_path_goes_around_a_block_into_a_garage(reverse):
    boxes = np.concatenate([GARAGE, BLOCK])
    path = plan(np.zeros(3), GOAL, boxes, SHAPE, reverse, 3000)
    assert np.allclose(path[0, :3], 0.0)
    assert np.allclose(path[-1, :2], GOAL[:2])
    assert math.cos(path[-1, 2] - GOAL[2]) == pytest.approx(1.0)
    assert np.hypot(*np.diff(path[:, :2], axis=0).T).max() < 0.2
    assert not any(touches(*pose[:3], SHAPE, boxes) for pose in path)
    assert reverse or (path[:, 3] > 0.0).all()


def test_there_is_no_path_into_a_closed_garage():
    closed = np.concatenate([GARAGE, [[0.0, 6.3, 0.0, 3.2, 0.2]]])
    assert len(plan(np.zeros(3), GOAL, closed, SHAPE, False, 200)) == 0
