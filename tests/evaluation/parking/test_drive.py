"""One lot with agents side by side: what they are shown, what they answer, and when they have failed."""

from __future__ import annotations

import numpy as np
import pytest

from dohyo.evaluation.agent import agent_info
from dohyo.evaluation.parking.agent import ParkingAgent
from dohyo.evaluation.parking.benchmark import load_parking_benchmark
from dohyo.evaluation.parking.drive import Drive, drive_lot
from dohyo.sumo_networks.parking import kart
from dohyo.sumo_networks.parking.generate import Scene
from dohyo.sumo_networks.parking.rows import LotView
from dohyo.sumo_networks.parking.world import ParkingWorld
from tests.evaluation.parking.parkers import Broken, Greedy, Seer

THREE = load_parking_benchmark("parking-three")
INFO = agent_info(Greedy(), "tests.evaluation.parking.parkers:Greedy", {}, "local")


def driven(*agents: ParkingAgent) -> Drive:
    """The drive of three agents in one lot."""
    return drive_lot(ParkingWorld(1, 3), THREE, THREE.seeds[0], agents, INFO)


class Mover(Seer):
    """Puts its kart into the spot instead of driving there."""

    def look(self, lot: LotView, number: int) -> None:
        """See `ParkingAgent`."""
        lot.karts[number, [kart.X, kart.Y]] = lot.spots[0, :2]


@pytest.mark.parametrize("rows", ["walls", "boxes", "spots", "walkers", "karts", "counts"])
def test_what_a_privileged_agent_sees_is_a_copy_that_it_cannot_write_to(rows):
    world = ParkingWorld(1, 3)
    world.draw([0], [1], Scene.PEDESTRIANS)
    seen, there = getattr(world.view(0).frozen(), rows), getattr(world.view(0), rows)
    assert np.array_equal(seen, there)
    assert not np.shares_memory(seen, there)
    with pytest.raises(ValueError, match="read-only"):
        seen[:] = 0


def test_an_agent_that_moves_its_kart_by_hand_has_failed_and_the_others_drive_as_without_it():
    drive = driven(Greedy(), Mover(), Greedy())
    moved = drive.record.karts[1]
    assert moved.ending == "failed"
    assert moved.failure == "act raised ValueError: assignment destination is read-only"
    assert np.array_equal(drive.motion[0, 1], drive.motion[1, 1])
    assert drive.record.motion_sha256 == driven(Greedy(), Broken(after=0), Greedy()).record.motion_sha256


@pytest.mark.parametrize("answer", [[1 + 1j, 0, -1], [1 + 0j, 0, -1]])
def test_complex_numbers_are_no_action(answer):
    one = driven(Broken(answer, after=0), Greedy(), Greedy()).record.karts[0]
    assert one.ending == "failed"
    assert one.failure.startswith("expected 3 finite numbers as action, got complex numbers: array([ 1.+")


@pytest.mark.parametrize(("after", "time_s"), [(0, 0.0), (3, 0.3), (20, 2.0)])
def test_a_kart_has_failed_when_its_agent_did(after, time_s):
    """Also where all have failed, so that the lot ends at once, and where the others drive on."""
    together, alone = driven(*(Broken(after=after) for _ in range(3))), driven(Greedy(), Broken(after=after), Greedy())
    assert [one.time_s for one in together.record.karts] == [time_s] * 3
    assert alone.record.karts[1].time_s == time_s
    assert len(alone.motion) > len(together.motion)
