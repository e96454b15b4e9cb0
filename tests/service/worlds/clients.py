"""A client of worlds, and the scenario of most tests: egos one behind the other on a street of Ingolstadt."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import httpx

from dohyo.sumo_networks.scenario import Mission, Place, Scenario, Traffic
from tests.service.serving import Served

SPEEDS = {"front": 9.0, "middle": 7.0, "back": 5.0}
AHEAD = [6.0, 0.0]
PATIENCE_S = 300.0


def scenario(egos: int = 3, goal_m: float = 20.0) -> Scenario:
    """Egos one behind the other on a street of Ingolstadt."""
    missions = tuple(
        Mission(
            name=name,
            start=Place(lane="737320747#3_2", position_m=50.0 - 15.0 * place),
            goal=Place(lane="737320747#4_2", position_m=goal_m),
        )
        for place, name in enumerate(list(SPEEDS)[:egos])
    )
    return Scenario(name="street", network="ingolstadt", missions=missions, traffic=Traffic(warm_up_s=0.0))


class Client:
    """Sends requests to a served service with one token."""

    def __init__(self, served: Served, token: str = "") -> None:
        self.url, self.token = served.url, token or served.token

    def send(self, method: str, path: str, document: Any = None, token: str = "") -> httpx.Response:
        headers = {"authorization": f"Bearer {token or self.token}"}
        return httpx.request(method, self.url + path, json=document, headers=headers, timeout=120)

    def world(self, **options: Any) -> str:
        """A new world."""
        answer = self.send("POST", "/v1/worlds", {"scenario": scenario().model_dump(mode="json")} | options)
        assert answer.status_code == 201, answer.text
        return str(answer.json()["id"])

    def get(self, world: str) -> Any:
        return self.send("GET", f"/v1/worlds/{world}").json()

    def order(self, world: str, what: str, document: Any = None) -> Any:
        answer = self.send("POST", f"/v1/worlds/{world}/{what}", document)
        assert answer.status_code == 200, answer.text
        return answer.json()

    def join(self, world: str, name: str, *egos: str, **options: Any) -> httpx.Response:
        asked = {"name": name, "egos": list(egos), "sensors": ["speedometer"], "control": "lane_command"}
        return self.send("POST", f"/v1/worlds/{world}/join", asked | options)

    def seat(self, world: str, name: str, *egos: str, **options: Any) -> Any:
        answer = self.join(world, name, *egos, **options)
        assert answer.status_code == 201, answer.text
        return answer.json()

    def step(self, seat: Any, tick: int, **actions: Any) -> httpx.Response:
        return self.send("POST", f"/v1/seats/{seat['seat']}/step", {"tick": tick, "actions": actions}, seat["token"])

    def now(self, seat: Any) -> Any:
        """What a place observes now."""
        answer = self.send("GET", f"/v1/seats/{seat['seat']}", token=seat["token"])
        assert answer.status_code == 200, answer.text
        return answer.json()

    def until(self, world: str, true: Callable[[Any], bool]) -> Any:
        """The world, once something holds for it."""
        ends = time.monotonic() + PATIENCE_S
        while not true(found := self.get(world)):
            assert time.monotonic() < ends, found
            time.sleep(0.05)
        return found
