from __future__ import annotations

import math

import numpy as np
import pytest

from dohyo.sumo_networks.ego.control import CONTROLS, InvalidActionError, make_control
from dohyo.sumo_networks.ego.dynamics import VehicleParameters
from dohyo.sumo_networks.ego.pose import WORLD_CONTROLS, ImplausiblePoseError, Pose, check_plausible
from dohyo.sumo_networks.errors import UnknownNameError
from dohyo.sumo_networks.scenario import Obstacle
from dohyo.sumo_networks.units import TICK_S
from dohyo.sumo_networks.world import ActorKind
from tests.conftest import Start
from tests.sumo_networks.simulation.drives import busy_road, driven, on, standing_at
from tests.worlds import straight_road

EAST = Pose(100.0, 0.0, 0.0, 10.0, 0.0)


@pytest.mark.parametrize(
    ("after", "words"),
    [
        (EAST._replace(x=101.0), ""),
        (EAST._replace(x=101.4, y=0.2), ""),
        (EAST._replace(x=150.0), "expected a place within"),
        (EAST._replace(x=100.0, velocity_x=10.0), "expected a place within"),  # it says that it moves, and stands
        (EAST._replace(x=104.0, velocity_x=70.0), "at most 60 m/s"),
        (EAST._replace(x=101.0, heading=math.pi), "turn of at most"),
    ],
)
def test_a_motion_that_no_vehicle_makes_is_refused(after: Pose, words: str) -> None:
    if words:
        with pytest.raises(ImplausiblePoseError, match=words):
            check_plausible(EAST, after, TICK_S)
    else:
        check_plausible(EAST, after, TICK_S)


def test_agents_of_evaluations_cannot_declare_poses() -> None:
    with pytest.raises(UnknownNameError, match="pose"):
        make_control("pose", VehicleParameters(), TICK_S)
    control = make_control("pose", VehicleParameters(), TICK_S, WORLD_CONTROLS)
    with pytest.raises(InvalidActionError, match="finite"):
        control.checked([0.0, math.nan, 0.0, 0.0, 0.0])
    assert control.repeated(np.array(EAST)).tolist() == [101.0, 0.0, 0.0, 10.0, 0.0]
    assert "pose" not in CONTROLS


def test_a_posed_ego_is_where_its_simulator_says_and_the_other_drives_as_before(start: Start) -> None:
    missions = standing_at(500.0), standing_at(440.0, lane="w_e_1", name="other")
    alone, _ = start(busy_road(*missions))
    before = [world.egos for world in driven(alone, (2.0, 0.01), 2.0)]
    simulation, world = start(busy_road(*missions))
    x, y = world.egos.position[0].tolist()
    for tick in range(20):
        speed = 0.4 * (tick + 1)
        x += speed * TICK_S
        world = simulation.tick(np.tile([2.0, 0.01], (2, 1)), {0: Pose(x, y, 0.0, speed, 0.0)})
        egos = world.egos
        np.testing.assert_allclose(egos.position[0], (x, y))
        assert (egos.speed[0], egos.heading[0]) == pytest.approx((speed, 0.0))
        assert egos.acceleration[0] == pytest.approx(4.0)
        np.testing.assert_array_equal(egos.position[1], before[tick].position[1])
    assert egos.driven[0] == pytest.approx(x - 500.0)
    assert egos.progress[0] == pytest.approx(x - 500.0, abs=0.1)


def test_a_posed_ego_inside_a_wall_touches_it(start: Start) -> None:
    simulation, world = start(on(straight_road(), standing_at(500.0), obstacles=(Obstacle(x_m=504.0, y_m=-4.8),)))
    y = world.egos.position[0, 1]
    for tick in range(4):
        world = simulation.tick(np.zeros((1, 2)), {0: Pose(501.0 + tick, y, 0.0, 10.0, 0.0)})
    assert [contact.kind for contact in world.contacts] == [ActorKind.STATIC]
