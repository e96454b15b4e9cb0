"""Actors that another simulator moves: SUMO's traffic yields to them, and the world lists them."""

from __future__ import annotations

import math

import libsumo
import numpy as np
import pytest

from dohyo.sumo_networks.actors.external import MOST_ACTORS, MOST_NAMES, SIZES, ExternalActor, ExternalActors
from dohyo.sumo_networks.envs.driving_env import DrivingEnv
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.scenario import Scenario, Traffic, TrafficFlow
from dohyo.sumo_networks.world import ActorKind
from tests.conftest import MakeEnv, Start
from tests.sumo_networks.simulation.drives import BRAKE, driven, in_ingolstadt, on, standing_at
from tests.worlds import straight_road

STAND = np.zeros(2)


def box(name: str, x: float, y: float, kind: ActorKind = ActorKind.CAR, heading: float = 0.0) -> ExternalActor:
    """An actor that stands."""
    return ExternalActor(name, kind, x, y, heading, 0.0, *SIZES[kind])


def flowing() -> Scenario:
    """Cars eastward in the right lane, seen by an ego that stands on the other side."""
    flow = TrafficFlow(source="w_e_0", target="w_e", type="car", gap_s=(3.0, 3.0))
    return on(straight_road(), standing_at(300.0, lane="e_w_1"), traffic=Traffic(warm_up_s=15.0, flows=(flow,)), seed=1)


@pytest.mark.parametrize(
    "kind_and_heading",
    [(ActorKind.TRUCK, 0.0), (ActorKind.CAR, math.pi / 2), (ActorKind.PEDESTRIAN, 1.5), (ActorKind.STATIC, 0.3)],
)
def test_traffic_does_not_drive_through_an_external_actor(
    kind_and_heading: tuple[ActorKind, float], start: Start
) -> None:
    kind, heading = kind_and_heading
    simulation, _ = start(flowing())
    put = [box(f"a{lane}", 340.0, y, kind, heading) for lane, y in enumerate((-4.8, -1.6))]
    simulation.external.put(put)
    worlds = driven(simulation, BRAKE, 30.0)
    actors = worlds[-1].actors
    own = np.array([worlds[-1].name_of(int(key)).startswith("external:") for key in actors.key])
    assert {(int(one), *place) for one, place in zip(actors.kind[own], actors.position[own].tolist(), strict=True)} == {
        (int(kind), one.x, one.y) for one in put
    }
    cars = actors.take(~own & (actors.position[:, 1] < 0.0))
    assert len(cars) >= 4
    assert (cars.position[:, 0] + 0.5 * cars.length < 340.0).all(), "all wait behind it"
    simulation.external.remove(one.name for one in put)
    gone = driven(simulation, BRAKE, 8.0)[-1]
    assert (gone.actors.position[gone.actors.position[:, 1] < 0.0, 0] > 345.0).any(), "they drive on"
    assert not [name for name in libsumo.vehicle.getIDList() if name.startswith("external")]


def test_the_place_of_an_external_actor_in_sumo_turns_with_it(start: Start) -> None:
    simulation, _ = start(on(straight_road(), standing_at(100.0)))
    length, width = SIZES[ActorKind.TRUCK]
    for heading, along in ((math.pi / 2, width), (0.0, length), (math.pi / 2, width)):
        simulation.external.put([box("one", 160.0, -4.8, ActorKind.TRUCK, heading)])
        driven(simulation, BRAKE, 0.3)
        (name,) = (one for one in libsumo.vehicle.getIDList() if one.startswith("external"))
        assert libsumo.vehicle.getLength(name) == pytest.approx(along, abs=0.01)
        assert libsumo.vehicle.getPosition(name)[0] == pytest.approx(160.0 + 0.5 * along, abs=0.05)


def test_sensors_and_contacts_see_an_external_actor(make_env: MakeEnv) -> None:
    env: DrivingEnv = make_env(on(straight_road(), standing_at(100.0)), sensors=("objects",), control="pedals_steering")
    before = env.reset()[0]["ego"]["objects"]
    env.external.put([box("one", 110.0, -4.8)])
    seen = env.step({"ego": np.zeros(3)})[0]["ego"]["objects"]
    assert ((before[:, 0] >= 0).sum(), (seen[:, 0] >= 0).sum()) == (0, 1)
    env.external.put([box("one", 103.0, -4.8)])
    env.step({"ego": np.zeros(3)})
    assert [env.world.name_of(contact.key) for contact in env.world.contacts] == ["external:one"]


def test_a_thousand_actors_that_move_all_over_a_city(start: Start) -> None:
    simulation, _ = start(in_ingolstadt())
    lanes = simulation.plan.network.lanes
    rng, size = np.random.default_rng(0), SIZES[ActorKind.CAR]
    low, high = lanes.points.min(axis=0)[:2], lanes.points.max(axis=0)[:2]
    place, heading = rng.uniform(low, high, (1000, 2)), rng.uniform(-4.0, 4.0, 1000)
    for _ in range(10):
        place += 0.5 * np.column_stack([np.cos(heading), np.sin(heading)])
        simulation.external.put(
            ExternalActor(f"a{i}", ActorKind.CAR, *place[i], heading[i], 5.0, *size) for i in range(1000)
        )
        world = driven(simulation, BRAKE, 0.1)[-1]
    seen = sum(world.name_of(int(key)).startswith("external:") for key in world.actors.key)
    assert seen == (np.hypot(*(place - world.egos.position[0]).T) <= 100.0).sum() > 20


def test_what_no_actor_can_be_is_refused(start: Start) -> None:
    with pytest.raises(InvalidInputError, match="finite place"):
        box("a", math.nan, 0.0)
    with pytest.raises(InvalidInputError, match="expected a name"):
        box("a b", 0.0, 0.0)
    with pytest.raises(InvalidInputError, match="speed of 0 to"):
        ExternalActor("a", ActorKind.CAR, 0.0, 0.0, 0.0, -1.0, 4.0, 2.0)
    with pytest.raises(InvalidInputError, match="expected a size"):
        ExternalActor("a", ActorKind.CAR, 0.0, 0.0, 0.0, 0.0, 4.0, math.inf)
    with pytest.raises(InvalidInputError, match="kind other than ego"):
        ExternalActor("a", ActorKind.EGO, 0.0, 0.0, 0.0, 0.0, 4.0, 2.0)
    external = start(on(straight_road(), standing_at(100.0)))[0].external
    external.put([box("a", 0.0, 0.0)])
    with pytest.raises(InvalidInputError, match="first kind and size"):
        external.put([box("b", 0.0, 0.0), box("a", 0.0, 0.0, ActorKind.BUS)])
    with pytest.raises(InvalidInputError, match="at most"):
        external.put(box(f"c{i}", 0.0, 0.0) for i in range(MOST_ACTORS))
    assert [one.name for one in external] == ["a"], "all or none"


def test_actors_are_removed_before_others_are_put() -> None:
    external = ExternalActors()
    external.put(box(f"a{i}", 0.0, 0.0) for i in range(MOST_ACTORS))
    others = [box(f"b{i}", 0.0, 0.0) for i in range(1200)]
    with pytest.raises(InvalidInputError, match="at most 2000 external actors"):
        external.change(others, [f"a{i}" for i in range(1199)])
    assert {one.name for one in external} == {f"a{i}" for i in range(MOST_ACTORS)}, "all or none"
    external.change([*others, box("a0", 1.0, 0.0)], [f"a{i}" for i in range(1201)])
    assert (len(external), {one.x for one in external if one.name == "a0"}) == (MOST_ACTORS, {1.0})


def test_an_actor_that_a_tick_has_shown_keeps_its_kind_and_size_also_after_it_was_removed() -> None:
    external = ExternalActors()
    external.put([box("a", 0.0, 0.0)])
    external.change([box("a", 0.0, 0.0, ActorKind.BUS)], ["a"])
    assert external.begin_tick() == []
    for gone in (["a"], []):
        external.remove(["a"])
        assert external.begin_tick() == gone
    with pytest.raises(InvalidInputError, match=r"first kind and size, bus of 12 by 2\.5 m"):
        external.put([box("a", 0.0, 0.0)])
    external.put([box("a", 5.0, 0.0, ActorKind.BUS)])


def test_the_names_of_a_simulation_are_bounded_and_removed_ones_may_come_again() -> None:
    external = ExternalActors()
    for first in range(0, MOST_NAMES, MOST_ACTORS):
        external.change((box(f"a{first + i}", 0.0, 0.0) for i in range(MOST_ACTORS)), [one.name for one in external])
        external.begin_tick()
    external.remove([one.name for one in external])
    with pytest.raises(InvalidInputError, match="at most 50000 names, got more; use removed ones again"):
        external.put([box("a0", 0.0, 0.0), box("new", 0.0, 0.0)])
    external.put([box("a0", 0.0, 0.0)])
    assert len(external) == 1
