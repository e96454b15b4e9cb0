"""EventManager without SUMO: what it asks the simulation for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dohyo.sumo_networks.actors.requests import CancelVehicle, ClearArea, HideActor, Request, ShowActor, SpawnVehicle
from dohyo.sumo_networks.events.manager import EventManager
from dohyo.sumo_networks.units import TICK_S
from tests.sumo_networks.events.stories import EVENT
from tests.worlds import Scene, stop_sign_crossing, straight_road


def managed(scene: Scene, kind: str, at_m: float = 0.0, **numbers: object) -> EventManager:
    event = EVENT.validate_python({"kind": kind, "name": "it", "at_m": at_m, **numbers})
    (route,) = scene.world().routes
    return EventManager(scene.network, (event,), ("ego",), (route,), np.random.SeedSequence(0))


def ticked(manager: EventManager, scene: Scene, *departed: str, time: float = 0.0) -> list[Request]:
    world = replace(scene.world(), time=time)
    return manager.update(world, world.egos, departed, TICK_S)


def test_an_actor_gets_room_before_it_is_shown_and_is_then_only_moved() -> None:
    scene = straight_road().with_ego(x=0.0)
    manager = managed(scene, "vehicle_appears")
    first, second = ticked(manager, scene), ticked(manager, scene)
    assert [type(request) for request in first] == [ClearArea, ShowActor]
    assert [type(request) for request in second] == [ShowActor]
    assert [actor.name for actor in manager.actors] == ["event:it-0"]


def test_an_actor_that_disappears_is_hidden() -> None:
    scene = straight_road().with_ego(x=0.0)
    manager = managed(scene, "vehicle_appears", stay_s=0.0)
    assert [type(request) for request in ticked(manager, scene)] == [ClearArea, HideActor]
    assert manager.actors == []


def test_actors_are_hidden_at_once_when_the_last_ego_has_left() -> None:
    scene = straight_road().with_ego(x=0.0)
    manager = managed(scene, "vehicle_appears")
    ticked(manager, scene)
    world = scene.world()
    gone = replace(world.egos, active=np.zeros(1, dtype=np.bool_))
    assert manager.update(world, gone, (), TICK_S) == [HideActor("event:it-0")]
    assert manager.update(world, gone, (), TICK_S) == []


def test_the_next_vehicle_of_a_flow_waits_until_the_last_one_has_entered() -> None:
    scene = stop_sign_crossing().with_ego(x=-100.0)
    manager = managed(scene, "enter_actor_flow", 60.0, gap_m=(1.0, 1.0))
    first = [request for request in ticked(manager, scene) if isinstance(request, SpawnVehicle)]
    assert first
    assert ticked(manager, scene, time=10.0) == []
    (after,) = ticked(manager, scene, first[-1].name, time=10.0)
    assert isinstance(after, SpawnVehicle)
    assert after.name not in {request.name for request in first}


def test_a_vehicle_that_still_waits_is_cancelled_when_the_event_ends() -> None:
    scene = stop_sign_crossing().with_ego(x=-100.0)
    manager = managed(scene, "enter_actor_flow", 60.0, timeout_s=1.0)
    spawned = [request.name for request in ticked(manager, scene) if isinstance(request, SpawnVehicle)]
    ended = ticked(manager, scene, *spawned[:-1], time=10.0)
    assert ended == [CancelVehicle(spawned[-1])]


@pytest.mark.parametrize("tick", [1, 33, 71, 152, 314])
def test_an_event_times_out_in_the_tick_of_its_limit_from_whatever_tick_on(tick: int) -> None:
    scene = stop_sign_crossing().with_ego(x=-100.0)
    manager = managed(scene, "enter_actor_flow", 60.0, timeout_s=1.0)
    begun = ticked(manager, scene, time=tick * TICK_S)
    spawned = [request.name for request in begun if isinstance(request, SpawnVehicle)]
    before = ticked(manager, scene, *spawned[:-1], time=(tick + 9) * TICK_S)
    assert CancelVehicle(spawned[-1]) not in before
    assert CancelVehicle(spawned[-1]) in ticked(manager, scene, time=(tick + 10) * TICK_S)
