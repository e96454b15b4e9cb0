"""Replay of a lot: what the player shows of contacts."""

from __future__ import annotations

import numpy as np
import pytest

from dohyo.evaluation.agent import agent_info
from dohyo.evaluation.parking.benchmark import load_parking_benchmark
from dohyo.evaluation.parking.drive import drive_lot
from dohyo.service.parking.replay import replay_of_lot
from dohyo.sumo_networks.parking.world import ParkingWorld
from tests.evaluation.parking.parkers import Greedy

COMPLEX = load_parking_benchmark("parking-complex")


class Fast(Greedy):
    """Drives straight ahead until something is in the way."""

    def act(self, observation: np.ndarray) -> np.ndarray:
        """See `ParkingAgent`."""
        return np.array([1.0, 0.0, -1.0])


@pytest.mark.parametrize("seed", COMPLEX.seeds[:3])
def test_a_contact_has_the_speed_before_it_and_the_place_of_it(seed: int) -> None:
    info = agent_info(Fast(), "tests.service.parking.test_replay:Fast", {}, "local")
    drive = drive_lot(ParkingWorld(1), COMPLEX, seed, [Fast()], info)
    (kart,) = drive.record.karts
    (contact,) = replay_of_lot(drive.record, drive.motion, episode="e")["egos"][0]["infractions"]
    assert kart.ending == "collided"
    assert contact["magnitude"] == pytest.approx(drive.motion[-2, 0, 3], abs=0.01)
    assert contact["magnitude"] > 1.0
    assert [contact["x_m"], contact["y_m"]] == pytest.approx(drive.motion[-1, 0, :2].tolist(), abs=0.01)
    assert contact["time_s"] == pytest.approx(kart.time_s)
