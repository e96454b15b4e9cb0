"""The examples of two simulators in one world, as users start them."""

from __future__ import annotations

import math
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import polars as pl
import pytest

from dohyo.evaluation.agent import Mission
from dohyo.sumo_networks.scenario import Place, Scenario, Traffic
from tests.service.serving import Served
from tests.service.worlds import fake_carla
from tests.service.worlds.clients import PATIENCE_S, Client

EXAMPLES = Path(__file__).parents[3] / "examples"
DEADLINE_S = 60
STREET = "737320747#3_2"


def street(name: str, start_m: float, goal_m: float = 45.0) -> Scenario:
    """One ego in the middle lane of a street of 53 m."""
    start, goal = Place(lane=STREET, position_m=start_m), Place(lane=STREET, position_m=goal_m)
    mission = Mission(name=name, start=start, goal=goal)
    return Scenario(network="ingolstadt", missions=(mission,), traffic=Traffic(warm_up_s=0.0))


def made(client: Client, scenario: Scenario, **options: Any) -> str:
    return client.world(scenario=scenario.model_dump(mode="json"), record=True, deadline_s=DEADLINE_S, **options)


def started(client: Client, example: str, *arguments: str) -> subprocess.Popen[str]:
    """An example in a process of its own, once it has joined."""
    command = [sys.executable, str(EXAMPLES / example), client.url, client.token, *arguments]
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background job ignores Ctrl-C
    try:
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    finally:
        signal.signal(signal.SIGINT, before)
    assert process.stdout is not None
    assert process.stdout.readline()
    return process


def ego_record(client: Client, world: str) -> Any:
    (found,) = client.send("GET", f"/v1/worlds/{world}/record").json()["egos"]
    return found


def trajectory(client: Client, world: str) -> pl.DataFrame:
    with tempfile.NamedTemporaryFile(suffix=".parquet") as file:
        file.write(client.send("GET", f"/v1/worlds/{world}/trajectory").content)
        file.flush()
        return pl.read_parquet(file.name)


def others_in(client: Client, world: str) -> list[str]:
    """Names of the actors of other simulators after the next tick, which nobody holds up."""
    look = client.seat(world, "look", coupled=True)
    began = time.monotonic()
    answer = client.step(look, look["tick"])
    assert answer.status_code == 200, answer.text
    assert time.monotonic() - began < DEADLINE_S / 2
    return [row["name"] for row in answer.json()["actors"] if row["name"].startswith("external:")]


def test_commonroads_multi_body_model_drives_a_mission(client: Client) -> None:
    world = made(client, street("ego", 8.0))
    process = started(client, "commonroad_plant.py", world, "ego", "8.0")
    assert process.wait(PATIENCE_S) == 0
    ended = client.until(world, lambda found: found["finished"] is not None)
    assert ended["status"] == "done"
    found = ego_record(client, world)
    assert (found["status"], found["infractions"]) == ("perfect", [])
    assert found["agent"]["control"] == "pose"
    speeds = trajectory(client, world)["speed"]
    assert speeds.max() > 6.0, "the multi-body model has driven, not only the kinematic one"


def test_two_worlds_mirror_each_others_egos(client: Client) -> None:
    standing = made(client, street("leader", 38.0, 50.0), undriven="stand")
    driving = made(client, street("follower", 8.0, 50.0))
    process = started(client, "mirror_worlds.py", standing, driving)
    for world in (standing, driving):
        client.order(world, "resume")
    assert process.wait(PATIENCE_S) == 0
    assert others_in(client, standing) == [], "the world goes on without the ego of the other one"
    client.order(standing, "end")
    follower = ego_record(client, driving)
    assert (follower["status"], follower["contacts"]) == ("perfect", 0)
    paths = [trajectory(client, world) for world in (standing, driving)]
    assert paths[1]["lateral"].abs().max() > 1.5, "it passes the leader, who is in the other world"
    seen = [set(path["name"]) for path in paths]
    mirrored = [f"external:mirrored:{world}:ego:{ego}" for world, ego in ((driving, "follower"), (standing, "leader"))]
    assert seen == [{"leader", mirrored[0]}, {"follower", mirrored[1]}]


def test_a_world_has_several_mirrors(client: Client, served: Served) -> None:
    other = Client(served, served.ask("POST", "/v1/tokens", {"owner": "other", "role": "submitter"})["token"])
    sides = [
        (one, made(one, street("ego", start), undriven="stand"))
        for one, start in ((client, 38.0), (client, 8.0), (other, 23.0))  # an owner has at most two worlds
    ]
    (_, first), *rest = sides
    mirrors = [started(client, "mirror_worlds.py", first, one.url, one.token, world) for one, world in rest]
    for one, world in sides:
        one.order(world, "resume")
    for (one, world), shown in zip(sides, (2, 1, 1), strict=True):
        assert one.until(world, lambda found: found["tick"] > 3)["actors"] == shown
    assert [mirror.poll() for mirror in mirrors] == [None, None]
    for mirror in mirrors:
        mirror.send_signal(signal.SIGINT)
        mirror.wait(PATIENCE_S)
    other.order(rest[1][1], "end")


def test_a_plant_that_was_killed_is_started_again_as_fast_as_its_ego(client: Client) -> None:
    world = made(client, street("ego", 8.0))
    client.order(world, "pause")
    killed = started(client, "commonroad_plant.py", world, "ego", "8.0")
    client.order(world, "step", {"ticks": 20})
    client.until(world, lambda found: found["tick"] == 20)
    killed.kill()
    killed.wait()
    again = started(client, "commonroad_plant.py", world, "ego", "8.0")
    client.order(world, "resume")
    assert again.wait(PATIENCE_S) == 0
    client.until(world, lambda found: found["finished"] is not None)
    speeds = trajectory(client, world)["speed"]
    assert speeds[20] > 6.0
    assert speeds.diff().abs().max() < 1.5, "no more than 15 m/s^2"


@pytest.mark.parametrize(
    ("example", "in_time"), [("commonroad_plant.py", True), ("commonroad_plant.py", False), ("world_worker.py", False)]
)
def test_an_example_goes_on_in_a_world_that_begins_anew(example: str, in_time: bool, client: Client) -> None:
    world = made(client, street("ego", 8.0))
    client.order(world, "pause")
    process = started(client, example, world, *["worker"] * (example == "world_worker.py"), "ego", "8.0")
    client.order(world, "step", {"ticks": 10})
    client.until(world, lambda found: found["tick"] == 10)
    if not in_time:  # the next step is of the run before
        process.send_signal(signal.SIGSTOP)
        client.order(world, "resume")
        time.sleep(0.5)
    client.order(world, "reset", {})
    process.send_signal(signal.SIGCONT)
    client.order(world, "resume")
    assert process.wait(PATIENCE_S) == 0, process.communicate()[1]
    ended = client.until(world, lambda found: found["finished"] is not None)
    assert (ended["status"], ended["resets"]) == ("done", 1)


NOBODY = "http://127.0.0.1:9"
WHO = ("token", "wo-1", "me", "ego")


@pytest.mark.parametrize(
    ("command", "message"),
    [
        (("world_worker.py",), "usage: "),
        (("world_worker.py", NOBODY, *WHO, "fast"), "expected a speed in m/s, got 'fast'"),
        (
            ("world_worker.py", NOBODY, *WHO, "8"),
            f"no answer from {NOBODY}/v1/worlds/wo-1/join",
        ),
        (("world_worker.py", "127.0.0.1:9", *WHO, "8"), "unknown url type"),
        (("world_worker.py", "here", *WHO, "8"), "unknown url type"),
        (("mirror_worlds.py",), "usage: "),
        (("mirror_worlds.py", NOBODY, "token", "wo-1", "wo-1"), "expected two different worlds, got wo-1 twice"),
        (("commonroad_plant.py",), "usage: "),
    ],
)
def test_a_mistake_in_the_command_is_told_without_a_traceback(command: tuple[str, ...], message: str) -> None:
    example, *arguments = command
    done = subprocess.run([sys.executable, EXAMPLES / example, *arguments], capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert message in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize("example", ["mirror_worlds.py", "world_worker.py", "commonroad_plant.py"])
def test_an_example_leaves_its_worlds_at_ctrl_c(example: str, client: Client) -> None:
    if example == "mirror_worlds.py":
        egos = {"leader": 38.0, "follower": 8.0}
        worlds = [made(client, street(*one), undriven="stand") for one in egos.items()]  # else they soon end
        process = started(client, example, *worlds)
    else:
        worlds = [made(client, street("ego", 8.0))]
        process = started(client, example, *worlds, *["worker"] * (example == "world_worker.py"), "ego", "1.0")
    for world in worlds:
        client.order(world, "resume")
    for world in worlds:
        client.until(world, lambda found: found["tick"] > 3)
    process.send_signal(signal.SIGINT)
    assert process.wait(PATIENCE_S) != 0
    assert process.communicate()[1] == "ended by Ctrl-C\n"
    for world in worlds:
        assert [ego["driver"] for ego in client.get(world)["egos"]] == [None]
        assert others_in(client, world) == []


def test_the_bridge_to_carla_with_a_stand_in(client: Client, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(EXAMPLES)
    import carla_bridge  # type: ignore[import-not-found]

    scenario = street("hero", 8.0)
    behind = scenario.missions[0].model_copy(update={"name": "behind", "start": Place(lane=STREET, position_m=1.0)})
    world = made(client, scenario.model_copy(update={"missions": (*scenario.missions, behind)}))
    look = client.seat(world, "look", coupled=True)
    client.send("POST", f"/v1/seats/{look['seat']}/leave", token=look["token"])
    (hero,) = [row for row in look["actors"] if row["name"] == "ego:hero"]

    carla = fake_carla.Client()
    yaw = -math.degrees(hero["heading_rad"])
    offset = carla_bridge.offset_of(client.url, client.token, world)
    assert offset == (-672401.23, -5399632.08)  # netOffset in the file of Ingolstadt

    def place(metres: float, left: float = 0.0) -> fake_carla.Transform:
        x = hero["x_m"] + metres * math.cos(hero["heading_rad"]) - left * math.sin(hero["heading_rad"])
        y = hero["y_m"] + metres * math.sin(hero["heading_rad"]) + left * math.cos(hero["heading_rad"])
        return fake_carla.Transform(fake_carla.Location(x - offset[0], -(y - offset[1])), fake_carla.Rotation(yaw=yaw))

    def spawned(kind: str, role: str, at: fake_carla.Transform) -> fake_carla.Actor:
        blueprint = fake_carla.ActorBlueprint(kind)
        blueprint.set_attribute("role_name", role)
        made = carla.world.try_spawn_actor(blueprint, at)
        assert made is not None
        return made

    spawned("vehicle.audi.tt", "hero", place(0.0)).acceleration = 2.0
    spawned("vehicle.audi.tt", "autopilot", place(20.0, left=8.0))
    spawned("walker.pedestrian.0009", "", place(10.0, left=9.0))
    bridge = carla_bridge.Bridge(fake_carla, carla, offset)
    client.order(world, "resume")
    tick = carla_bridge.couple(bridge, client.url, client.token, world, "hero")
    (shown,) = bridge.shown.values()
    assert (shown.attributes["role_name"], shown.get_transform().location.z) == ("dohyo", 0.3)
    driven = math.dist(*((one.location.x, one.location.y) for one in (shown.places[0], shown.places[-1])))
    assert driven > 5.0, "the autopilot drives it behind the hero"
    bridge.close()
    assert (len(carla.world.actors), carla.world.settings.synchronous_mode) == (3, False)
    ended = client.send("POST", f"/v1/worlds/{world}/end")
    assert ended.status_code in (200, 409), "on a slow machine the ego behind arrives before, and the world has ended"
    record = client.send("GET", f"/v1/worlds/{world}/record").json()
    assert record["egos"][0]["status"] == "perfect"
    assert record["egos"][0]["driven_m"] == pytest.approx(0.5 * 2.0 * (0.1 * tick) ** 2, rel=0.01)
    kinds = trajectory(client, world).filter(pl.col("name").str.starts_with("external"))["kind"]
    assert set(kinds) == {0, 6}
