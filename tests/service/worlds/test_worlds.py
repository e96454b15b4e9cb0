"""Worlds over HTTP, with a served service and workers in processes of their own."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import httpx
import pytest

from dohyo.evaluation.episode.runner import drive_episode
from dohyo.evaluation.records.store import read_record
from dohyo.service.client.downloads import signature_of
from dohyo.sumo_networks.sensors import SENSORS
from tests.service.serving import Served, serving
from tests.service.worlds.agents import Keeper
from tests.service.worlds.clients import AHEAD, PATIENCE_S, SPEEDS, Client, scenario

ROOT = Path(__file__).parents[3]


def worker(client: Client, world: str, name: str) -> subprocess.Popen[str]:
    """The example, in a process of its own, once it has joined."""
    program = str(ROOT / "examples" / "world_worker.py")
    arguments = [client.url, client.token, world, f"driver-{name}", name, str(SPEEDS[name])]
    process = subprocess.Popen([sys.executable, program, *arguments], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert "drives" in process.stdout.readline()
    return process


def test_three_workers_drive_as_one_process_would_also_after_kill_9(client: Client) -> None:
    alone, _ = drive_episode(scenario(), {name: Keeper(speed) for name, speed in SPEEDS.items()})
    world = client.world(record=True, deadline_s=120)
    client.order(world, "pause")
    workers = {name: worker(client, world, name) for name in SPEEDS}
    try:
        client.order(world, "step", {"ticks": 20})
        client.until(world, lambda found: found["tick"] == 20)
        workers["middle"].send_signal(signal.SIGKILL)
        workers["middle"].wait()
        client.order(world, "resume")
        workers["middle"] = worker(client, world, "middle")
        assert [process.wait(PATIENCE_S) for process in workers.values()] == [0, 0, 0]
    finally:
        for process in workers.values():
            process.kill()
            process.wait()
    ended = client.until(world, lambda found: found["finished"] is not None)
    assert (ended["status"], ended["reason"], ended["tick"]) == ("done", None, alone.ticks)
    record = client.send("GET", f"/v1/worlds/{world}/record").json()
    assert record["trajectory_sha256"] == alone.trajectory_sha256
    assert (record["record_hash"], record["benchmark"]) == (ended["record_hash"], None)
    assert [(ego["agent"]["name"], ego["agent"]["kind"]) for ego in record["egos"]] == [
        (f"driver-{name}", "remote") for name in SPEEDS
    ]
    assert [ego["status"] for ego in record["egos"]] == [ego.status.value for ego in alone.egos]
    assert client.send("GET", f"/v1/worlds/{world}/trajectory").content[:4] == b"PAR1"
    assert client.send("DELETE", f"/v1/worlds/{world}").status_code == 204
    assert client.send("GET", f"/v1/worlds/{world}/record").status_code == 404


def test_egos_without_drivers_end_their_drives_after_the_last_worker_has(client: Client) -> None:
    world = client.world(scenario=scenario(2).model_dump(mode="json"), record=True)
    process = worker(client, world, "front")
    client.order(world, "resume")
    assert process.wait(PATIENCE_S) == 0
    ended = client.until(world, lambda found: found["finished"] is not None)
    assert (ended["status"], ended["reason"]) == ("done", None)
    record = client.send("GET", f"/v1/worlds/{world}/record").json()
    assert [(ego["agent"]["name"], ego["status"]) for ego in record["egos"]] == [
        ("driver-front", "perfect"),
        ("autopilot", "perfect"),
    ]


def test_late_gone_and_doubled_drivers(client: Client) -> None:
    world = client.world(deadline_s=10, late="leave", undriven="stand", record=True)
    front, rest = client.seat(world, "a", "front"), client.seat(world, "b", "middle", "back")
    assert client.get(world)["status"] == "running"
    assert client.join(world, "c", "front").status_code == 409
    assert client.step(front, 0, front=[None, 0.0]).status_code == 422
    assert client.step(front, 0, front=AHEAD, back=AHEAD).status_code == 422
    late = client.step(front, 0, front=AHEAD).json()  # waits for "b", which says nothing and loses its place
    assert (late["tick"], list(late["observations"])) == (1, ["front"])
    assert client.step(rest, 0, middle=AHEAD, back=AHEAD).status_code == 410
    assert [ego["driver"] for ego in client.get(world)["egos"]] == ["a", None, None]
    assert client.step(front, 0, front=[0.0, 0.0]).json() == late
    stale = client.step(front, 5, front=AHEAD)
    assert (stale.status_code, stale.json()["expected_tick"]) == (409, 1)

    again = client.seat(world, "a", "front")  # a second client of the same name takes over
    assert (again["tick"], client.step(front, 1, front=AHEAD).status_code) == (1, 410)
    assert client.step(again, 1, front=AHEAD).json()["tick"] == 2
    back = client.seat(world, "late", "back")
    assert back["tick"] == 2
    assert client.send("POST", f"/v1/seats/{back['seat']}/leave", token=again["token"]).status_code == 401
    assert client.send("POST", f"/v1/seats/{back['seat']}/leave", token=back["token"]).status_code == 204
    assert client.step(again, 2, front=AHEAD).json()["tick"] == 3
    ended = client.order(world, "end")
    assert (ended["status"], ended["reason"]) == ("ended", "its owner ended the world")
    record = client.send("GET", f"/v1/worlds/{world}/record").json()
    assert [ego["agent"]["name"] for ego in record["egos"]] == [
        "a",
        "standing",
        "standing",
    ]  # no tick was of the others
    assert {ego["failure"] for ego in record["egos"]} == {"its owner ended the world"}


def test_a_late_decision_is_repeated_and_counted(client: Client) -> None:
    document = scenario(2).model_dump(mode="json")
    world = client.world(scenario=document, deadline_s=6, undriven="out")
    a, b = client.seat(world, "a", "front"), client.seat(world, "b", "middle")
    client.order(world, "pause")
    client.order(world, "step", {"ticks": 2})
    with httpx.Client() as other:
        headers = {"authorization": f"Bearer {b['token']}"}
        body = {"tick": 0, "actions": {"middle": AHEAD}}
        patience = httpx.Timeout(PATIENCE_S, read=1.5)  # for the service to read the request
        with pytest.raises(httpx.ReadTimeout):  # the request is gone, its decision counts
            other.post(f"{client.url}/v1/seats/{b['seat']}/step", json=body, headers=headers, timeout=patience)
    assert client.step(a, 0, front=AHEAD).json()["tick"] == 1
    assert client.step(a, 1, front=AHEAD).json()["tick"] == 2
    assert client.step(b, 1, middle=AHEAD).json()["missed"] == 1
    assert client.send("POST", f"/v1/seats/{b['seat']}/leave", token=b["token"]).status_code == 204
    client.order(world, "step", {"ticks": 1})
    client.step(a, 2, front=AHEAD)
    assert [ego["driving"] for ego in client.get(world)["egos"]] == [True, False]


def test_nobody_else_sees_a_world_and_no_owner_has_too_many(client: Client, served: Served) -> None:
    made = {
        role: served.ask("POST", "/v1/tokens", {"owner": owner, "role": role})
        for role, owner in (("submitter", "mine"), ("worker", "mine"), ("organiser", "stranger"))
    }
    tokens = {role: one["token"] for role, one in made.items()}
    mine, stranger = Client(served, tokens["submitter"]), Client(served, tokens["organiser"])
    helper = Client(served, tokens["worker"])
    world = mine.world()
    assert [one["id"] for one in mine.send("GET", "/v1/worlds").json()["items"]] == [world]
    assert stranger.send("GET", "/v1/worlds").json()["items"] == []
    for method, path in [("GET", ""), ("GET", "/record"), ("POST", "/resume"), ("POST", "/end"), ("DELETE", "")]:
        assert stranger.send(method, f"/v1/worlds/{world}{path}").status_code == 404, path
    assert stranger.join(world, "x", "front").status_code == 404
    assert helper.send("POST", f"/v1/worlds/{world}/pause").status_code == 403
    assert helper.seat(world, "x", "front")["tick"] == 0
    assert httpx.get(f"{served.url}/v1/worlds/{world}", timeout=120).status_code == 401
    assert client.send("DELETE", f"/v1/tokens/{made['worker']['id']}").status_code == 204
    mine.until(world, lambda found: found["egos"][0]["driver"] is None)
    mine.world()
    asked = {"benchmark": "fleet", "mission": "ingolstadt"}
    assert mine.send("POST", "/v1/worlds", asked).status_code == 429


def test_a_world_of_a_networks_name_with_missions_that_are_drawn(client: Client) -> None:
    obstacle = {"x_m": 0.0, "y_m": 0.0}
    asked = {"network": "ingolstadt", "missions": 2, "traffic": {"vehicles": 5, "warm_up_s": 1.0}, "seed": 7}
    more = {"conditions": "wet", "obstacles": [obstacle], "record": True}
    made = client.send("POST", "/v1/worlds", asked | more)
    assert made.status_code == 201, made.text
    world = made.json()
    told = (world["network"], world["seed"], [ego["name"] for ego in world["egos"]])
    assert told == ("ingolstadt", 7, ["m01", "m02"])
    client.order(world["id"], "end")
    kept = client.send("GET", f"/v1/worlds/{world['id']}/record").json()["scenario"]
    assert (kept["conditions"], kept["traffic"]["vehicles"], len(kept["obstacles"])) == ("wet", 5, 1)
    missions = [one | {"name": f"own-{one['name']}"} for one in kept["missions"]]
    again = client.send("POST", "/v1/worlds", {"network": "ingolstadt", "missions": missions})
    assert [ego["name"] for ego in again.json()["egos"]] == ["own-m01", "own-m02"]


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        ({}, "expected one of benchmark, scenario and network, got none"),
        ({"benchmark": "fleet", "network": "ingolstadt"}, "got benchmark and network"),
        ({"benchmark": "fleet", "missions": 2}, "missions beside a network only"),
        ({"network": "/etc/passwd"}, "no network named"),
        ({"network": "ingolstadt", "traffic": {"cars": 1}}, "traffic.cars"),
        ({"network": "ingolstadt", "conditions": "hail"}, "hail"),
        ({"benchmark": "fleet", "mission": "nowhere"}, "no mission named 'nowhere'"),
        ({"benchmark": "dissipation"}, "expected one of drives"),
        ({"scenario": {"network": "/etc/passwd", "missions": []}}, "scenario.missions"),
        ({"scenario": scenario().model_dump(mode="json") | {"network": "/etc/passwd"}}, "no network named"),
        ({"scenario": scenario(goal_m=1e6).model_dump(mode="json")}, "scenario:"),
    ],
)
def test_a_scenario_that_cannot_be_is_refused(asked: Any, words: str, client: Client) -> None:
    before = len(client.send("GET", "/v1/worlds").json()["items"])
    answer = client.send("POST", "/v1/worlds", asked)
    assert answer.status_code == 422, answer.text
    assert words in answer.json()["detail"]
    assert len(client.send("GET", "/v1/worlds").json()["items"]) == before


def test_worlds_end_when_nobody_asks_and_when_their_service_ends(tmp_path: Path) -> None:
    data = tmp_path / "data"
    with serving(data, before="import os; os.environ['DOHYO_WORLD_IDLE_S'] = '6'") as first:
        before = Client(first)
        stranger = Client(first, first.ask("POST", "/v1/tokens", {"owner": "stranger", "role": "submitter"})["token"])
        idle = before.world(record=True)
        listed = listed_until(before, idle, lambda found: finished_while_asked(stranger, found))
        assert (listed["status"], listed["reason"]) == ("ended", "no request came for 6 s")
        stopped = before.world(record=True)
        before.step(before.seat(stopped, "a", "front", "middle", "back"), 0, **dict.fromkeys(SPEEDS, AHEAD))
        assert first.end(signal.SIGTERM) == 0
    with serving(data) as second:
        after = Client(second, before.token)
        found = after.get(stopped)
        assert (found["status"], found["reason"], found["tick"]) == ("ended", "the service ended", 1)
        for world in (idle, stopped):
            answer = after.send("GET", f"/v1/worlds/{world}/record")
            path = tmp_path / f"{world}.json"
            path.write_bytes(answer.content)
            record = read_record(path)
            signed = signature_of(answer.headers, record.record_hash)
            assert signed is not None
            signed.check(record)
        killed = after.world(record=True)
        after.seat(killed, "a", "front")
        assert second.end(signal.SIGKILL) == -signal.SIGKILL
    with serving(data, before="import os; os.environ['DOHYO_RECORDS_KEPT_DAYS'] = '0.00001'") as third:
        last = Client(third, before.token)
        found = last.get(killed)
        assert (found["status"], found["record_hash"]) == ("failed", None)
        assert found["reason"] == "the service ended while the world was live"
        assert last.send("GET", f"/v1/worlds/{stopped}/record").status_code == 410
        assert last.send("GET", f"/v1/worlds/{stopped}/trajectory").status_code == 410
        assert last.get(stopped)["record_hash"], "its hash stays"
    assert not list((data / "worlds").glob("*.parquet"))


def finished_while_asked(stranger: Client, found: Any) -> bool:
    """Whether a world has ended, for which a stranger asks in vain at every look."""
    assert stranger.send("GET", f"/v1/worlds/{found['id']}").status_code == 404
    return found["finished"] is not None


def listed_until(client: Client, world: str, true: Callable[[Any], bool]) -> Any:
    """The world in the list, which is no request to the world, once something holds for it."""
    ends = time.monotonic() + PATIENCE_S
    while True:
        (found,) = [one for one in client.send("GET", "/v1/worlds").json()["items"] if one["id"] == world]
        if true(found):
            return found
        assert time.monotonic() < ends, found
        time.sleep(0.1)


def the_same_request_steps_once(client: Client, world: str) -> None:
    client.order(world, "pause")
    headers = {"authorization": f"Bearer {client.token}", "idempotency-key": "two ticks"}

    def step(ticks: int) -> int:
        address = f"{client.url}/v1/worlds/{world}/step"
        return httpx.post(address, json={"ticks": ticks}, headers=headers, timeout=120).status_code

    assert [step(2), step(2), step(2), step(3)] == [200, 200, 200, 422]
    client.until(world, lambda found: found["tick"] >= 2)
    assert client.order(world, "pause")["tick"] == 2


def test_the_same_request_makes_one_world(client: Client) -> None:
    document = {"scenario": scenario(1).model_dump(mode="json")}
    headers = {"authorization": f"Bearer {client.token}", "idempotency-key": "once"}

    def send(body: Any) -> httpx.Response:
        return httpx.post(f"{client.url}/v1/worlds", json=body, headers=headers, timeout=120)

    with ThreadPoolExecutor(2) as pool:
        made = [one.result().json()["id"] for one in [pool.submit(send, document), pool.submit(send, document)]]
    assert made[0] == made[1] == send(document).json()["id"]
    assert send(document | {"record": True}).status_code == 422, "the key was for another request"
    the_same_request_steps_once(client, made[0])
    client.order(made[0], "end")
    assert client.send("DELETE", f"/v1/worlds/{made[0]}").status_code == 204
    assert send(document).json()["id"] != made[0], "it was deleted"


def test_an_invited_owner_joins_and_controls_nothing(client: Client, served: Served) -> None:
    def made(owner: str, role: str = "submitter") -> Client:
        return Client(served, served.ask("POST", "/v1/tokens", {"owner": owner, "role": role})["token"])

    host, guest, stranger = made("host"), made("guest"), made("stranger")
    world = host.world(record=True, undriven="stand")
    assert guest.join(world, "g", "back").status_code == 404
    assert host.send("POST", f"/v1/worlds/{world}/invitations", {"egos": ["nobody"]}).status_code == 422
    invited = host.send("POST", f"/v1/worlds/{world}/invitations", {"egos": ["back"]})
    code = invited.json()["code"]
    assert (invited.status_code, guest.join(world, "g", "back", invitation="dohyo_world_x").status_code) == (201, 404)
    seat = guest.seat(world, "g", "back", invitation=code)
    assert stranger.join(world, "s", "back", invitation=code).status_code == 404, "a code is for one owner"
    assert guest.join(world, "g", "front").status_code == 403
    assert guest.join(world, "g", "back", coupled=True).status_code == 403
    assert host.join(world, "g", "middle").status_code == 409, "nobody takes the place of another owner"
    again = guest.seat(world, "g", "back")
    assert (guest.get(world)["id"], guest.send("GET", "/v1/worlds").json()["items"][0]["id"]) == (world, world)
    assert guest.step(seat, 0, back=AHEAD).status_code == 410
    for what in ("pause", "resume", "reset", "pace", "end", "invitations", "actors"):
        assert guest.send("POST", f"/v1/worlds/{world}/{what}", {}).status_code == 403, what
        assert stranger.send("POST", f"/v1/worlds/{world}/{what}", {}).status_code == 404, what
    host.order(world, "resume")
    assert guest.step(again, 0, back=AHEAD).json()["tick"] == 1
    host.order(world, "end")
    assert guest.send("DELETE", f"/v1/worlds/{world}").status_code == 403
    assert guest.send("GET", f"/v1/worlds/{world}/record").json()["egos"][2]["agent"]["name"] == "g"
    assert stranger.send("GET", f"/v1/worlds/{world}/record").status_code == 404
    assert host.send("DELETE", f"/v1/worlds/{world}").status_code == 204
    assert guest.send("GET", "/v1/worlds").json()["items"] == []


def test_a_place_that_would_observe_too_much_is_refused(client: Client) -> None:
    """All sensors of an ego have 1.8 MB a tick."""
    world, all_of = client.world(), {"sensors": list(SENSORS), "track": "privileged"}
    many = client.join(world, "a", *(f"ego-{number}" for number in range(5)), **all_of)
    assert (many.status_code, "at most 8,000,000 bytes a tick" in many.json()["detail"]) == (422, True)
    assert client.join(world, "a", "front", **all_of).status_code == 201


def test_who_joins_again_and_again_leaves_few_places_behind(client: Client) -> None:
    world = client.world(scenario=scenario(1).model_dump(mode="json"), stays=True)
    seats = [client.seat(world, "a", "front") for _ in range(30)]
    assert client.now(seats[-1])["tick"] == 0
    statuses = [client.send("GET", f"/v1/seats/{one['seat']}", token=one["token"]).status_code for one in seats[:-1]]
    assert statuses == [401] * 9 + [410] * 20
