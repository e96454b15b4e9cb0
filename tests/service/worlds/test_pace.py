"""Worlds by the wall clock, and worlds that begin anew."""

from __future__ import annotations

import threading
from typing import Any

from dohyo.evaluation.agent import Mission
from dohyo.evaluation.episode.runner import drive_episode
from dohyo.sumo_networks.scenario import Place, Scenario, Traffic
from tests.service.worlds.agents import Keeper
from tests.service.worlds.clients import AHEAD, Client, scenario

STAND = [0.0, 0.0]


def alone(client: Client, **options: Any) -> str:
    """A world with one ego."""
    return client.world(scenario=scenario(1).model_dump(mode="json"), **options)


def test_real_time_goes_on_without_decisions_and_counts_them(client: Client) -> None:
    world = alone(client, pace="realtime", speed=10.0, deadline_s=60)
    seat = client.seat(world, "a", "front")
    assert client.get(world)["tick"] == 0, "a first decision is waited for"
    assert client.step(seat, 0, front=STAND).json()["tick"] == 1
    client.until(world, lambda found: found["tick"] >= 5)
    late = client.step(seat, 1, front=STAND).json()
    assert late["tick"] > 5, "a late decision is for the present tick"
    assert late["missed"] >= 4
    paused = client.order(world, "pause")
    assert (paused["pace"], paused["speed"]) == ("realtime", 10.0)
    changed = client.order(world, "pace", {"pace": "realtime", "speed": 20.0})
    client.order(world, "resume")
    client.until(world, lambda found: found["tick"] >= changed["tick"] + 3)
    held = client.order(world, "pace", {"pace": "lockstep"})
    now = client.now(seat)
    assert (held["pace"], client.step(seat, now["tick"], front=STAND).json()["tick"]) == ("lockstep", now["tick"] + 1)


def test_decisions_count_in_a_world_that_is_slower_than_its_pace(client: Client) -> None:
    """It is always at a tick, so that every decision comes while a repetition is being driven."""
    world = alone(client, pace="realtime", speed=100.0, deadline_s=60, stays=True)
    seat = client.seat(world, "a", "front")
    client.step(seat, 0, front=STAND)
    client.until(world, lambda found: found["tick"] >= 20)
    seen = client.now(seat)
    assert seen["observations"]["front"]["speedometer"][0] < 0.1
    client.step(seat, seen["tick"], front=AHEAD)
    assert client.until(world, lambda found: found["status"] == "over")["tick"] > 20, "it reaches its goal"


def test_a_silent_worker_loses_its_place_in_a_world_that_is_slower_than_its_pace(client: Client) -> None:
    world = alone(client, pace="realtime", speed=100.0, deadline_s=0.5, stays=True)
    client.step(client.seat(world, "a", "front"), 0, front=STAND)
    client.until(world, lambda found: found["egos"][0]["driver"] is None)


def test_a_silent_worker_loses_its_place_in_real_time(client: Client) -> None:
    world = alone(client, pace="realtime", deadline_s=0.3)
    client.step(client.seat(world, "a", "front"), 0, front=AHEAD)
    found = client.until(world, lambda found: found["egos"][0]["driver"] is None)
    client.until(world, lambda later: later["tick"] > found["tick"])


def test_a_world_begins_anew_with_its_drivers_and_another_seed(client: Client) -> None:
    start, goal = Place(lane="737320747#3_2", position_m=10.0), Place(lane="737320747#3_2", position_m=45.0)
    mission = Mission(name="front", start=start, goal=goal)
    made = Scenario(network="ingolstadt", missions=(mission,), traffic=Traffic(vehicles=20, warm_up_s=2.0))
    expected, _ = drive_episode(made.model_copy(update={"seed": 7}), {"front": Keeper(8.0)})
    world = client.world(scenario=made.model_dump(mode="json"), stays=True, record=True)
    seat = client.seat(world, "a", "front")
    for tick in range(3):
        client.step(seat, tick, front=AHEAD)
    client.order(world, "pause")
    held: list[Any] = []
    waiting = threading.Thread(target=lambda: held.append(client.step(seat, 3, front=AHEAD).json()))
    waiting.start()
    begun = client.order(world, "reset", {"seed": 7})
    assert (begun["tick"], begun["resets"], begun["seed"], begun["status"]) == (0, 1, 7, "paused")
    client.order(world, "resume")
    now = client.now(seat)
    if now["tick"] == 0:
        assert client.step(seat, 1, front=AHEAD).status_code == 409
    while not now["done"]:
        assert now["resets"] == 1
        speed = min(8.0, now["observations"]["front"]["speedometer"][0] + 0.5)
        now = client.step(seat, now["tick"], front=[speed, 0.0]).json()
    waiting.join()
    over = client.get(world)
    assert (over["status"], over["finished"]) == ("over", None)
    ended = client.order(world, "end")
    assert (ended["status"], ended["seed"], ended["tick"]) == ("ended", 7, expected.ticks)
    record = client.send("GET", f"/v1/worlds/{world}/record").json()
    assert record["scenario"]["seed"] == 7
    assert record["trajectory_sha256"] == expected.trajectory_sha256


def test_a_world_that_is_over_can_be_reset(client: Client) -> None:
    world = alone(client, stays=True, undriven="out")
    client.order(world, "pause")
    client.order(world, "step", {"ticks": 1})
    client.until(world, lambda found: found["status"] == "over")
    assert client.order(world, "reset", {})["status"] == "running"
    assert client.seat(world, "a", "front")["tick"] == 0
