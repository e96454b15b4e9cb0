"""RemoteEnv: worlds of a service as the rows of a vector environment, equal to one of this process."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import gymnasium
import numpy as np
import pytest

import dohyo
from dohyo.agents.learning.gymnasium.task import GymnasiumTask
from dohyo.agents.learning.tasks.environments import check_environments
from dohyo.service.client import connection
from dohyo.service.client.client import Client
from dohyo.sumo_networks.envs.driving_env import DrivingEnv
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.scenario import Mission, Place, Scenario, Traffic
from tests.service.serving import Served, serving

SENSORS = ("speedometer", "route")
STREET = Scenario(
    name="street",
    network="ingolstadt",
    missions=(
        Mission(start=Place(lane="737320747#3_2", position_m=30.0), goal=Place(lane="737320747#3_2", position_m=50.0)),
    ),
    traffic=Traffic(vehicles=4, warm_up_s=0.0),
)


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    with serving(tmp_path_factory.mktemp("remote") / "data") as one:
        yield one


def drive_locally(seed: int, actions: np.ndarray) -> list[tuple[np.ndarray, float, bool]]:
    """What an environment of this process gives: observation, reward, termination."""
    env = DrivingEnv(STREET, sensors=SENSORS)
    name = env.possible_agents[0]
    observation = env.reset(seed)[0][name]
    given = [(np.concatenate([observation[one].ravel() for one in SENSORS]), 0.0, False)]
    for action in actions:
        seen, rewards, terminations, _, _ = env.step({name: action})
        given.append((np.concatenate([seen[name][one].ravel() for one in SENSORS]), rewards[name], terminations[name]))
        if not env.agents:
            break
    env.close()
    return given


def test_a_remote_episode_equals_a_local_one_also_after_a_reset(served: Served) -> None:
    actions = np.tile(np.float32([6.0, 0.0]), (60, 1))
    local = drive_locally(7, actions)
    scenario = STREET.model_dump(mode="json")
    env = dohyo.RemoteEnv(served.url, 2, token=served.token, scenario=scenario, sensors=SENSORS)
    try:
        for seeds, mask in ([3, 7], [True, True]), ([7, None], [True, False]):
            seen, infos = env.reset(seed=seeds, options={"reset_mask": mask})
            assert not infos["lost"].any()
            row = seeds.index(7)
            for step, (observation, reward, terminated) in enumerate(local):
                if step:
                    seen, rewards, terminations, truncations, infos = env.step(np.stack([actions[step - 1]] * 2))
                    assert (rewards[row], terminations[row], truncations[row]) == (reward, terminated, False)
                np.testing.assert_array_equal(np.concatenate([seen[one][row] for one in SENSORS]), observation)
            assert terminated
            assert infos["success"][row]
        served.ask("POST", f"/v1/worlds/{served.ask('GET', '/v1/worlds')['items'][0]['id']}/end")
        assert sorted(env.reset(seed=1)[1]["lost"].tolist()) == [False, True]
        assert not env.reset(seed=1)[1]["lost"].any()  # it has made another world
    finally:
        env.close()
    assert [one for one in served.ask("GET", "/v1/worlds")["items"] if one["finished"] is None] == []


def test_a_row_whose_world_ends_is_truncated_and_lost(served: Served) -> None:
    env = dohyo.RemoteEnv(served.url, token=served.token, scenario=STREET.model_dump(mode="json"), sensors=SENSORS)
    actions = np.float32([[6.0, 0.0]])
    try:
        env.reset(seed=1)
        assert not env.step(actions)[4]["lost"].any()
        (live,) = [one for one in served.ask("GET", "/v1/worlds")["items"] if one["finished"] is None]
        served.ask("POST", f"/v1/worlds/{live['id']}/end")
        _, rewards, terminations, truncations, infos = env.step(actions)
        assert (rewards.tolist(), terminations.tolist(), truncations.tolist()) == ([0.0], [False], [True])
        assert infos["lost"].tolist() == [True]
        assert not env.reset(seed=1)[1]["lost"].any()  # in another world
        assert live["id"] not in [one["id"] for one in served.ask("GET", "/v1/worlds")["items"]], "it was deleted"
    finally:
        env.close()


def test_a_row_whose_world_somebody_else_resets_is_truncated_and_lost(served: Served) -> None:
    """Its action is for tick 0 of the run before, and the new run is at tick 0 too."""
    env = dohyo.RemoteEnv(served.url, token=served.token, scenario=STREET.model_dump(mode="json"), sensors=SENSORS)
    try:
        env.reset(seed=1)
        (live,) = [one for one in served.ask("GET", "/v1/worlds")["items"] if one["finished"] is None]
        served.ask("POST", f"/v1/worlds/{live['id']}/reset", {"seed": 2})
        infos = env.step(np.float32([[6.0, 0.0]]))[4]
        assert infos["lost"].tolist() == [True]
        assert not env.reset(seed=1)[1]["lost"].any()
        assert not env.step(np.float32([[6.0, 0.0]]))[4]["lost"].any()
    finally:
        env.close()


def test_more_rows_than_an_owner_may_have_worlds_are_refused_at_once(served: Served) -> None:
    scenario = STREET.model_dump(mode="json")
    env = dohyo.RemoteEnv(served.url, 3, token=served.token, scenario=scenario, sensors=SENSORS)
    began = time.monotonic()
    try:
        with pytest.raises(InvalidInputError, match="3 rows are as many worlds, and the service has at most 2"):
            env.reset(seed=1)
        assert time.monotonic() - began < 60.0
    finally:
        env.close()
    assert [one for one in served.ask("GET", "/v1/worlds")["items"] if one["finished"] is None] == []


def test_learners_take_an_address_as_their_environment(served: Served, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DOHYO_TOKEN", served.token)
    task = GymnasiumTask(f"{served.url}?benchmark=quickstart&sensors=speedometer&reward=progress")
    assert task.observation_space["speedometer"].shape == (2,)
    environments = task.make_environments(1, processes=True)
    check_environments(environments)
    environments.close()
    with pytest.raises(InvalidInputError, match="expected options benchmark"):
        gymnasium.make_vec("dohyo/Remote-v0", url=f"{served.url}?colour=red")


class _Impatient(BaseHTTPRequestHandler):
    """Answers, and closes a connection that is idle for a moment."""

    protocol_version = "HTTP/1.1"

    def do_POST(self) -> None:
        self.rfile.read(int(self.headers["content-length"]))
        self.send_response(204)
        self.end_headers()
        self.connection.settimeout(0.2)  # from now on: a slow machine has time for its first request

    def log_message(self, *_: object) -> None: ...


def test_a_learner_may_pause_for_longer_than_the_service_keeps_a_connection(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(connection, "IDLE_S", 0.1)
    server = ThreadingHTTPServer(("127.0.0.1", 0), _Impatient)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    kept = connection.Connection(f"http://127.0.0.1:{server.server_port}")
    try:
        for _ in range(3):
            assert kept.post("/", {}, "token") is None
            time.sleep(0.5)
    finally:
        kept.close()
        server.shutdown()
        server.server_close()


def test_the_client_makes_steps_resets_and_ends_a_world(served: Served) -> None:
    with Client(served.url, served.token) as client:
        world = client.create_world({"scenario": STREET.model_dump(mode="json"), "record": True})["id"]
        assert client.pause_world(world)["status"] == "paused"
        client.step_world(world, 3)
        assert client.reset_world(world, seed=5)["seed"] == 5
        ended = client.end_world(world)
        assert client.world_record(world)["record_hash"] == ended["record_hash"] == client.world(world)["record_hash"]
