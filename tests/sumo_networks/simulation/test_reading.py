"""What the simulation leaves unread to save time, it would have read the same."""

from __future__ import annotations

from types import SimpleNamespace

import libsumo
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dohyo.sumo_networks.networks.catalog import load_network
from dohyo.sumo_networks.routes.edge_graph import draw
from dohyo.sumo_networks.scenario import Mission, Place, Scenario, Traffic
from dohyo.sumo_networks.simulation import surroundings
from dohyo.sumo_networks.simulation.signals import _LIGHTS
from dohyo.sumo_networks.units import SIGHT_M, TICK_S
from dohyo.sumo_networks.world import LightState, World
from tests.conftest import Start

MISSIONS = {
    "ingolstadt": ("737320747#3_2", "726514449_2"),
    "adlershof": ("46039050#0_2", "414563781_4"),
}


def drive(network: str, traffic: Traffic) -> Scenario:
    start, goal = MISSIONS[network]
    mission = Mission(start=Place(lane=start, position_m=8.0), goal=Place(lane=goal, position_m=-15.0))
    return Scenario(network=network, missions=(mission,), traffic=traffic, seed=3)


def around(world: World) -> set[str]:
    """Everyone whom SUMO has within sight of the ego now; asked one by one."""
    x, y = world.egos.position[0]
    found = set()
    for domain in (libsumo.vehicle, libsumo.person):
        for name in domain.getIDList():
            px, py = domain.getPosition(name)
            if (px - x) ** 2 + (py - y) ** 2 <= SIGHT_M**2 and not name.startswith("ego:"):
                found.add(name)
    return found


@pytest.mark.parametrize("drive_mps2", [0.0, 3.0])
def test_nobody_who_comes_into_sight_is_missed(start: Start, drive_mps2: float) -> None:
    simulation, world = start(drive("ingolstadt", Traffic(vehicles=40, bicycles=8, pedestrians=30, warm_up_s=5.0)))
    newcomers, before = 0, around(world)
    for _ in range(400):
        world = simulation.tick(np.array([[drive_mps2, 0.0]]))
        now = around(world)
        assert {world.name_of(int(key)) for key in world.actors.key} == now
        newcomers += len(now - before)
        before = now
    assert newcomers > 5


class FakeSumo:
    """One vehicle, far away at first, and how often it was asked."""

    def __init__(self) -> None:
        self.place, self.asked, self.moved_on = (1000.0, 0.0), 0, 0
        nobody = SimpleNamespace(getPosition=None, getAngle=None, getSpeed=None, getLaneID=None, getIDList=lambda: ())
        self.person, self.poi = nobody, SimpleNamespace(add=lambda *_: None)
        self.simulation = SimpleNamespace(getEndingTeleportNumber=lambda: self.moved_on)
        self.vehicle = SimpleNamespace(
            getIDList=lambda: ("vehicle-1",),
            getPosition=self._position,
            getAngle=lambda _: 90.0,
            getSpeed=lambda _: 5.0,
            getLaneID=lambda _: "a_0",
            getSignals=lambda _: 0,
        )

    def _position(self, name: str) -> tuple[float, float]:
        self.asked += 1
        return self.place


def test_who_is_far_is_asked_seldom_and_whoever_sumo_moves_on_is_seen_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    sumo = FakeSumo()
    monkeypatch.setattr(surroundings, "libsumo", sumo)
    eyes = surroundings.Surroundings(Traffic(vehicles=1), egos=1)
    eyes.add("ego:ego")
    for _ in range(70):
        assert eyes.read() == []
    assert sumo.asked == 1, "900 m at 2 x 60 m/s take 75 ticks"
    sumo.place, sumo.moved_on = (50.0, 0.0), 1
    assert eyes.read() == [("vehicle-1", 50.0, 0.0, 90.0, 5.0, "a_0", 0)]


def test_the_fastest_of_all_is_seen_in_the_first_tick_in_sight(monkeypatch: pytest.MonkeyPatch) -> None:
    sumo = FakeSumo()
    monkeypatch.setattr(surroundings, "libsumo", sumo)
    eyes = surroundings.Surroundings(Traffic(vehicles=1), egos=1)
    eyes.add("ego:ego")
    step = 2 * surroundings.FASTEST_MPS * TICK_S
    for distance in np.arange(1000.0, 0.0, -step).tolist():
        sumo.place = (distance, 0.0)
        assert bool(eyes.read()) == (distance <= SIGHT_M)


@pytest.mark.parametrize("network", sorted(MISSIONS))
def test_every_signal_is_what_sumo_shows_at_every_tick(start: Start, network: str) -> None:
    simulation, world = start(drive(network, Traffic(vehicles=20, warm_up_s=0.0)))
    signals, changes = load_network(network).signals, 0
    for _ in range(400):
        before, world = world, simulation.tick(np.zeros((1, 2)))
        texts = [libsumo.trafficlight.getRedYellowGreenState(str(light)) for light in signals.light_ids]
        shown = [texts[light][link] for light, link in zip(signals.light, signals.link, strict=True)]
        assert world.signals.tolist() == [int(_LIGHTS.get(letter, LightState.OFF)) for letter in shown]
        changes += int((world.signals != before.signals).any())
    assert changes > 3


@given(st.lists(st.floats(0.0, 100.0), min_size=1, max_size=40).filter(lambda w: sum(w) > 1e-3), st.integers(0, 999))
def test_a_draw_is_what_numpy_draws(weights: list[float], seed: int) -> None:
    weight = np.array(weights)
    ours, numpys = np.random.default_rng(seed), np.random.default_rng(seed)
    for _ in range(5):
        assert draw(ours, weight) == int(numpys.choice(len(weight), p=weight / weight.sum()))
    assert ours.random() == numpys.random()
