"""Features of a kart's observation, by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from dohyo.agents.parking.training.features import FEATURES, KartFeatures
from dohyo.agents.parking.training.guided import GuidedVectorEnv
from dohyo.sumo_networks.parking import kart
from dohyo.sumo_networks.parking.generate import Scene
from dohyo.sumo_networks.parking.tables import TARGET
from dohyo.sumo_networks.parking.vector_env import Level


def test_the_spot_is_where_the_kart_would_have_to_look_for_it():
    lots = GuidedVectorEnv(4, [Level(Scene.COMPLEX)])
    seen, _ = lots.reset(seed=[0, 1, 2, 3])
    found = KartFeatures()({name: torch.from_numpy(one) for name, one in seen.items()}).numpy()
    assert found.shape == (4, FEATURES)
    for lot in range(4):
        view = lots.world.view(lot)
        body, spot = view.karts[0], view.spots[view.counts[0, TARGET]]
        dx, dy = spot[0] - body[kart.X], spot[1] - body[kart.Y]
        bearing = math.atan2(dy, dx) - body[kart.HEADING]
        assert found[lot, 2] == pytest.approx(math.cos(bearing), abs=1e-4)
        assert found[lot, 3] == pytest.approx(math.sin(bearing), abs=1e-4)
        along = -(dx * math.cos(spot[2]) + dy * math.sin(spot[2]))
        beside = dx * math.sin(spot[2]) - dy * math.cos(spot[2])
        assert found[lot, 6] == pytest.approx(math.tanh(along / 5.0), abs=1e-4)
        assert found[lot, 8] == pytest.approx(math.tanh(beside / 5.0), abs=1e-4)


def test_what_is_near_counts_more_than_what_is_far():
    seen = np.zeros((1, 64), np.float32)
    seen[0, 19::5] = [1.0, 0.5, 0.1, 0.05, 0.01, 0.005, 0.0, 0.0, 0.0]
    near = KartFeatures()({"observation": torch.from_numpy(seen)})[0, 16:25]
    assert (near.diff() >= 0.0).all()
    assert near[-1] == 1.0
