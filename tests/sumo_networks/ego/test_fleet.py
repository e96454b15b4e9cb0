"""The fleet: egos that have left keep their last values."""

from __future__ import annotations

import numpy as np
import pytest

from dohyo.sumo_networks.ego.dynamics import VehicleParameters
from dohyo.sumo_networks.ego.fleet import EgoFleet
from tests.worlds import straight_road


@pytest.mark.parametrize("seconds", [0.1, 0.2])
def test_an_ego_that_has_left_keeps_all_its_values(seconds: float) -> None:
    scene = straight_road()
    fleet = EgoFleet(scene.network, ("one", "two"), (scene.route,) * 2, VehicleParameters(), (10.0, 10.0))
    fleet.advance(np.array([[1.0, 0.1], [1.0, 0.1]]), 0.1)
    before = fleet.read(None)
    fleet.active[0] = False
    fleet.advance(np.array([[-8.0, -0.3], [-8.0, -0.3]]), seconds)
    after = fleet.read(before)
    for name in ("position", "heading", "speed", "acceleration", "yaw_rate"):
        assert getattr(after, name)[0] == pytest.approx(getattr(before, name)[0])
        assert getattr(after, name)[1] != pytest.approx(getattr(before, name)[1])
    assert after.motion[0] == pytest.approx(np.broadcast_to(before.motion[0, -1], after.motion[0].shape))
