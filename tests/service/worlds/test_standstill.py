"""A service that stands still takes no time from the workers of its worlds."""

from __future__ import annotations

import signal
import time
from pathlib import Path
from typing import Any

from tests.service.serving import Served, serving
from tests.service.worlds.clients import AHEAD, Client, scenario

DEADLINE_S = 3.0
STANDSTILL_S = 5.0
IDLE = "import os; os.environ['DOHYO_WORLD_IDLE_S'] = '4'"


def stand_still(served: Served) -> None:
    """The whole service stops, as on a machine that sleeps, and goes on."""
    served.process.send_signal(signal.SIGSTOP)
    time.sleep(STANDSTILL_S)
    served.process.send_signal(signal.SIGCONT)


def drive(client: Client, world: str) -> tuple[Any, int]:
    """A place that has decided once."""
    seat = client.seat(world, "a", "front")
    return seat, client.step(seat, 0, front=AHEAD).json()["tick"]


def test_no_decision_is_late_and_no_world_idle_because_the_service_stood_still(tmp_path: Path) -> None:
    with serving(tmp_path / "data", before=IDLE) as served:
        client = Client(served)
        for rules in ({"late": "leave"}, {"late": "repeat"}, {"pace": "realtime", "speed": 0.1}):
            document = scenario(1).model_dump(mode="json")
            world = client.world(scenario=document, deadline_s=DEADLINE_S, **rules)
            seat, tick = drive(client, world)
            stand_still(served)
            answer = client.step(seat, tick, front=AHEAD)
            assert answer.status_code == 200, answer.text
            assert answer.json()["tick"] > tick
            assert "pace" in rules or answer.json()["missed"] == 0
            assert client.get(world)["finished"] is None
            client.order(world, "end")
