"""Vehicles and actors of other simulators in a world."""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import httpx
import msgspec
import pytest

from dohyo.sumo_networks.scenario import Obstacle
from dohyo.sumo_networks.world import ActorKind
from tests.service.worlds.clients import AHEAD, Client, scenario


def row(name: str, x: float, y: float, **options: Any) -> dict[str, Any]:
    """A car that stands."""
    return {"name": name, "kind": "car", "x_m": x, "y_m": y, "heading_rad": 0.0, "speed_mps": 0.0} | options


def ego_row(answer: Any, name: str) -> Any:
    """The row of an ego in what a coupled place is shown."""
    (found,) = [one for one in answer["actors"] if one["name"] == f"ego:{name}"]
    return found


def at_rest(found: Any) -> list[float]:
    """The pose of a row that stands."""
    return [found["x_m"], found["y_m"], found["heading_rad"], 0.0, 0.0]


def moved(found: Any, metres: float) -> list[float]:
    """A pose ahead of a row, with the velocity that leads there in a tick."""
    cos, sin = math.cos(found["heading_rad"]), math.sin(found["heading_rad"])
    x, y = found["x_m"] + metres * cos, found["y_m"] + metres * sin
    return [x, y, found["heading_rad"], 10.0 * metres * cos, 10.0 * metres * sin]


def put(client: Client, seat: Any, tick: int, actors: Any, **actions: Any) -> httpx.Response:
    """A step that changes actors."""
    body = {"tick": tick, "actions": actions, "actors": actors}
    return client.send("POST", f"/v1/seats/{seat['seat']}/step", body, seat["token"])


def test_a_pose_is_driven_and_a_lie_is_refused_and_a_wall_is_judged(client: Client) -> None:
    plain = scenario(2)
    probe = client.world(scenario=plain.model_dump(mode="json"))
    at = ego_row(client.seat(probe, "look", coupled=True), "front")
    wall = moved(at, 8.0)
    walled = plain.model_copy(update={"obstacles": (Obstacle(x_m=wall[0], y_m=wall[1], length_m=2.0, width_m=2.0),)})
    world = client.world(scenario=walled.model_dump(mode="json"), record=True, undriven="stand")
    plant = client.seat(world, "plant", "front", control="pose", coupled=True)
    client.order(world, "resume")
    for lie, words in [
        ([None, *wall[1:]], "expected numbers"),
        (moved(at, 50.0), "at most 60 m/s"),
        ([*wall[:3], 0.0, 0.0], "expected a place within"),
        ([*at_rest(at)[:2], wall[2] + math.pi, 0.0, 0.0], "turn of at most"),
    ]:
        refused = client.step(plant, 0, front=lie)
        assert (refused.status_code, words in refused.json()["detail"]) == (422, True), refused.text
    nan = msgspec.msgpack.encode({"tick": 0, "actions": {"front": [math.nan] * 5}})
    headers = {"authorization": f"Bearer {plant['token']}", "content-type": "application/msgpack"}
    refused = httpx.post(f"{client.url}/v1/seats/{plant['seat']}/step", content=nan, headers=headers, timeout=120)
    assert (refused.status_code, "finite" in refused.json()["detail"]) == (422, True)
    for tick in range(10):
        told = moved(at, 1.0)
        answer = client.step(plant, tick, front=told).json()
        at = ego_row(answer, "front")
        assert [at["x_m"], at["y_m"], at["speed_mps"]] == pytest.approx([*told[:2], 10.0])
        assert answer["observations"]["front"]["speedometer"][0] == pytest.approx(10.0)
    assert client.order(world, "end")["status"] == "ended"
    egos = client.send("GET", f"/v1/worlds/{world}/record").json()["egos"]
    assert [one["kind"] for one in egos[0]["infractions"]] == ["collision_static"]
    assert (egos[0]["driven_m"], egos[1]["infractions"]) == (pytest.approx(10.0), [])


def test_actors_of_two_simulators_and_of_the_owner(client: Client) -> None:
    world = client.world(undriven="stand")
    assert client.join(world, "nobody").status_code == 422, "neither an ego nor coupled"
    driver = client.seat(world, "driver", "middle", sensors=["objects"], track="privileged")
    sim = client.seat(world, "sim", coupled=True)
    other = client.seat(world, "other", coupled=True)
    client.order(world, "resume")
    leader, at = ego_row(sim, "front"), ego_row(sim, "middle")

    thousand = [row(f"s{i}", leader["x_m"] + 40.0, leader["y_m"] + 0.1 * i) for i in range(1000)]
    ahead = moved(at, 6.0)
    truck = row("truck", *ahead[:2], kind="truck", heading_rad=at["heading_rad"])
    posted = client.send("POST", f"/v1/worlds/{world}/actors", {"put": [truck]})
    assert (posted.status_code, client.get(world)["actors"]) == (204, 1)
    assert put(client, driver, 0, {"put": [row("x", 0.0, 0.0)]}, middle=AHEAD).status_code == 422
    assert put(client, sim, 0, {"remove": ["truck"]}).status_code == 409, "the owner put it"
    assert put(client, sim, 0, {"put": [row("bad", 0.0, 0.0, speed_mps=-1.0)]}).status_code == 422
    with ThreadPoolExecutor(3) as pool:
        steps = [
            pool.submit(put, client, sim, 0, {"put": thousand}),
            pool.submit(put, client, other, 0, {"put": [row("o1", 0.0, 0.0)]}),
            pool.submit(client.step, driver, 0, middle=[0.0, 0.0]),
        ]
        answers = [one.result().json() for one in steps]
    assert {one["role"] for one in answers[0]["actors"]} == {"ego"}, "those who put actors know them"
    kinds = [int(one[0]) for one in answers[2]["observations"]["middle"]["objects"] if one[0] >= 0]
    assert (int(ActorKind.TRUCK) in kinds, int(ActorKind.CAR) in kinds) == (True, True)
    assert client.get(world)["actors"] == 1002
    assert client.send("POST", f"/v1/seats/{sim['seat']}/leave", token=sim["token"]).status_code == 204
    assert client.get(world)["actors"] == 2, "its actors are gone with it"
    again = client.seat(world, "other", coupled=True)
    assert put(client, again, 1, {"put": [row("o1", 1.0, 0.0, kind="bus")]}).status_code == 422, (
        "a bus was no car before"
    )
    assert client.order(world, "reset", {"seed": 1})["actors"] == 0


def test_an_actor_that_is_removed_and_put_again_between_two_ticks_is_there(client: Client) -> None:
    world = client.world(undriven="stand")
    seat = client.seat(world, "sim", "front", sensors=["objects"], track="privileged", coupled=True)
    client.order(world, "resume")
    ahead = moved(ego_row(seat, "front"), 10.0)
    seen = []
    for tick in range(3):
        if tick > 0:
            assert client.send("POST", f"/v1/worlds/{world}/actors", {"remove": ["one"]}).status_code == 204
        one = {"put": [row("one", ahead[0] + tick, ahead[1])]}
        assert client.send("POST", f"/v1/worlds/{world}/actors", one).status_code == 204
        answer = client.step(seat, tick, front=[0.0, 0.0]).json()
        seen.append([found[1] for found in answer["observations"]["front"]["objects"] if 5.0 < found[1] < 20.0])
    assert [len(one) for one in seen] == [1, 1, 1]
    assert seen[2] != seen[1] != seen[0], "and it has moved"


def named(first: int, count: int) -> list[str]:
    """Names of actors."""
    return [f"c{first + i}" for i in range(count)]


def cars(first: int, count: int) -> list[dict[str, Any]]:
    """Cars of these names, far from all egos."""
    return [row(name, 0.0, 0.0) for name in named(first, count)]


@pytest.mark.parametrize(
    "changes",
    [
        [{"remove": named(0, 1200), "put": cars(2000, 1200)}],
        [{"remove": named(0, 1200)}, {"put": cars(2000, 1200)}],
        [
            change
            for first in (2000, 3000, 4000)
            for change in ({"put": cars(first, 700)}, {"remove": named(first, 700)})
        ],
    ],
    ids=["in_one_request", "in_two_requests", "unseen"],
)
def test_a_world_goes_on_after_any_exchange_of_its_actors(client: Client, changes: list[dict[str, Any]]) -> None:
    world = client.world(undriven="stand")
    sim = client.seat(world, "sim", coupled=True)
    client.order(world, "resume")
    for tick, sent in enumerate([[{"put": cars(0, 1200)}], changes]):
        for change in sent:
            assert client.send("POST", f"/v1/worlds/{world}/actors", change).status_code == 204
        assert client.step(sim, tick).json()["tick"] == tick + 1
    assert (client.get(world)["status"], client.get(world)["actors"]) == ("running", 1200)


def test_the_faster_of_two_simulators_decides_nothing_in_the_record(client: Client) -> None:
    hashes = set()
    for order in (("a", "b"), ("b", "a")):
        world = client.world(undriven="stand", record=True)
        seats = {name: client.seat(world, name, coupled=True) for name in ("a", "b")}
        client.order(world, "resume")
        x, y = moved(ego_row(seats["a"], "front"), 20.0)[:2]
        rows = {"a": [row("z", x, y), row("m", x, y + 3.0)], "b": [row("k", x + 8.0, y, kind="van")]}
        with ThreadPoolExecutor(1) as pool:
            first = pool.submit(put, client, seats[order[0]], 0, {"put": rows[order[0]]})
            client.until(world, lambda found: found["actors"] > 0)
            assert put(client, seats[order[1]], 0, {"put": rows[order[1]]}).status_code == 200
            assert first.result().status_code == 200
        client.order(world, "end")
        client.until(world, lambda found: found["finished"] is not None)
        hashes.add(client.send("GET", f"/v1/worlds/{world}/record").json()["trajectory_sha256"])
    assert len(hashes) == 1


def test_actors_go_with_the_simulator_whose_egos_have_driven(client: Client) -> None:
    world = client.world(scenario=scenario(2).model_dump(mode="json"), undriven="stand")
    sim = client.seat(world, "sim", "front", coupled=True)
    client.order(world, "resume")
    x, y, *_ = moved(ego_row(sim, "middle"), -10.0)
    answer = put(client, sim, 0, {"put": [row("ghost", x, y)]}, front=AHEAD)
    while not (reply := answer.json())["done"]:
        answer = client.step(sim, reply["tick"], front=AHEAD)
        assert answer.status_code == 200, answer.text
    look = client.seat(world, "look", coupled=True)
    seen = client.step(look, look["tick"]).json()["actors"]
    assert [one["name"] for one in seen] == ["ego:middle"]
    assert client.get(world)["actors"] == 0
