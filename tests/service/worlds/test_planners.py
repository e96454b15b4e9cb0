"""Built-in planners as workers of one world: GHRL and MBAPPE drive as they do in one process."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from contextlib import closing

import numpy as np

from dohyo.agents.registry import resolve
from dohyo.evaluation.agent import Mission, make_agent
from dohyo.evaluation.episode.runner import drive_episode
from dohyo.service.client.connection import Connection
from dohyo.service.wire.messages import arrays, pack
from tests.service.worlds.clients import PATIENCE_S, Client, scenario


def drive_through_the_wire(client: Client, world: str, name: str, ego: str) -> None:
    """A built-in planner as a worker: it joins, and drives its ego to the end."""
    agent = make_agent(resolve(name))
    asked = agent.spec.model_dump(mode="json", include={"name", "track", "sensors", "control"}) | {"egos": [ego]}
    seated = client.send("POST", f"/v1/worlds/{world}/join", asked).json()
    (mission,) = (Mission.model_validate(one) for one in seated["missions"])
    agent.reset(mission, seated["seed"])
    with closing(Connection(client.url)) as http:
        http.send("GET", f"/v1/seats/{seated['seat']}", None, seated["token"])
        reply = http.receive()
        while not reply["done"]:
            action = pack(np.asarray(agent.act(arrays(reply["observations"])[ego])))
            step = {"tick": reply["tick"], "actions": {ego: action}}
            reply = http.post(f"/v1/seats/{seated['seat']}/step", step, seated["token"])
    agent.close()


def test_two_planners_drive_through_workers_as_they_do_in_one_process(client: Client) -> None:
    planners = {"front": "ghrl", "middle": "mbappe"}
    alone, _ = drive_episode(scenario(2), {ego: make_agent(resolve(name)) for ego, name in planners.items()})
    world = client.world(scenario=scenario(2).model_dump(mode="json"), record=True, deadline_s=120)
    with ThreadPoolExecutor(2) as threads:
        driven = [threads.submit(drive_through_the_wire, client, world, name, ego) for ego, name in planners.items()]
        for one in driven:
            one.result(PATIENCE_S)
    client.until(world, lambda found: found["finished"] is not None)
    record = client.send("GET", f"/v1/worlds/{world}/record").json()
    assert record["trajectory_sha256"] == alone.trajectory_sha256
    assert [ego["agent"]["name"] for ego in record["egos"]] == [ego.agent.name for ego in alone.egos]
