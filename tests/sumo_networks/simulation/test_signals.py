"""What lights show and ask for, read from SUMO."""

from __future__ import annotations

import libsumo
import numpy as np
import pytest

from dohyo.sumo_networks.rules.right_of_way import RightOfWay
from dohyo.sumo_networks.scenario import Scenario, Traffic
from dohyo.sumo_networks.sensors import make_sensors
from dohyo.sumo_networks.world import LightState, World
from tests.conftest import Start
from tests.lights import side_road
from tests.sumo_networks.simulation.drives import in_ingolstadt, on
from tests.worlds import Scene

OFF, RED, YELLOW, GREEN = LightState.OFF, LightState.RED, LightState.YELLOW, LightState.GREEN
MAJOR, YIELD, STOP = RightOfWay.MAJOR, RightOfWay.YIELD, RightOfWay.STOP


def alone(scene: Scene) -> Scenario:
    """The scene's mission on an empty road."""
    return on(scene, traffic=Traffic(warm_up_s=0.0))


def told(world: World) -> tuple[int, int]:
    """Signal and right of way of the next junction, as an agent sees them."""
    row = make_sensors(["junctions_ahead"])[0].read(world, 0)[0]
    return int(row[2]), int(row[3])


@pytest.mark.parametrize(
    ("letter", "light", "duty"),
    [
        pytest.param("s", OFF, STOP, id="green right-turn arrow"),
        pytest.param("o", OFF, YIELD, id="blinking"),
        pytest.param("O", OFF, MAJOR, id="off"),
        ("G", GREEN, MAJOR),
        ("g", GREEN, MAJOR),
        ("y", YELLOW, MAJOR),
        ("r", RED, MAJOR),
    ],
)
@pytest.mark.parametrize("later", ["G", "s"])
def test_a_light_asks_for_what_it_shows(
    start: Start, letter: str, light: LightState, duty: RightOfWay, later: str
) -> None:
    scene = side_road((letter, 60), (later, 60))
    assert [passage.control for passage in scene.route.passages] == ["o"], "the road's own letter does not count"
    _, world = start(alone(scene))
    assert told(world) == (light, duty)


def test_what_it_asks_for_changes_with_its_phases_and_for_its_own_connection_alone(start: Start) -> None:
    simulation, world = start(alone(side_road(("r", 2), ("s", 3), ("o", 2), ("G", 9))))
    asked = {"s": (OFF, STOP), "o": (OFF, YIELD), "G": (GREEN, MAJOR), "r": (RED, MAJOR)}
    (passage,), letters = world.routes[0].passages, set()
    for _ in range(90):
        (letter,) = set(libsumo.trafficlight.getRedYellowGreenState("c")) - {"G"} or {"G"}
        assert told(world) == asked[letter]
        assert np.flatnonzero(world.duties).tolist() == [passage.signal] * (letter in "so")
        letters.add(letter)
        world = simulation.tick(np.zeros((1, 2)))
    assert letters == set(asked)


@pytest.mark.parametrize("scenario", [alone(side_road(("G", 2), ("y", 1), ("r", 9))), in_ingolstadt()])
def test_where_no_light_can_ask_for_anything_nothing_is_read(start: Start, scenario: Scenario) -> None:
    simulation, world = start(scenario)
    for _ in range(40):
        assert len(world.duties) == 0
        world = simulation.tick(np.zeros((1, 2)))
