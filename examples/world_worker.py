"""A worker that joins a world of a dohyo service and drives one ego; it needs nothing but Python.

    python world_worker.py http://127.0.0.1:8000 TOKEN WORLD NAME EGO 8.0

The last argument is the speed to keep, m/s. Ctrl-C leaves the world. After a crash, who is started again by the same
NAME takes the place back.
"""

from __future__ import annotations

import contextlib
import json
import sys
import time
import urllib.error
import urllib.request
from typing import Any

PATIENCE_S = 120.0


def post(url: str, token: str, document: dict[str, Any]) -> dict[str, Any]:
    """Posts a document and returns the answer."""
    headers = {"Authorization": f"Bearer {token}", "Content-Type": "application/json"}
    return _answer(urllib.request.Request(url, json.dumps(document).encode(), headers))


def get(url: str, token: str) -> dict[str, Any]:
    """Reads a document."""
    return _answer(urllib.request.Request(url, headers={"Authorization": f"Bearer {token}"}))


def _answer(request: urllib.request.Request) -> dict[str, Any]:
    """The answer to a request, which is sent again while the service answers "not now"."""
    while True:
        try:
            with urllib.request.urlopen(request, timeout=PATIENCE_S) as answer:
                return dict(json.load(answer))
        except urllib.error.HTTPError as error:
            if error.code not in (429, 503):
                sys.exit(f"{error.code}: {json.load(error)['detail']}")
            time.sleep(float(error.headers.get("Retry-After", "1")))


def leave(server: str, seat: dict[str, Any]) -> None:
    """Leaves a world, which then waits for this place no more. One that has ended, or is lost, needs nothing."""
    url, headers = f"{server}/v1/seats/{seat['seat']}/leave", {"Authorization": f"Bearer {seat['token']}"}
    with contextlib.suppress(OSError):  # an answer of the service, too
        urllib.request.urlopen(urllib.request.Request(url, b"{}", headers), timeout=10.0).close()


def decide(observation: dict[str, Any], speed_mps: float) -> list[float]:
    """Target speed and change of lane: a little faster than now, up to the speed to keep."""
    return [min(speed_mps, observation["speedometer"][0] + 0.5), 0.0]


def main() -> None:
    """Joins a world, and drives until its ego has ended its drive."""
    server, token, world, name, ego, speed = sys.argv[1:]
    asked = {"name": name, "egos": [ego], "sensors": ["speedometer"], "control": "lane_command"}
    seat = post(f"{server}/v1/worlds/{world}/join", token, asked)
    print(f"{name} drives {ego} from tick {seat['tick']}", flush=True)
    reply: dict[str, Any] = seat | {"done": False}
    try:
        while not reply["done"]:
            actions = {ego: decide(seen, float(speed)) for ego, seen in reply["observations"].items()}
            step = {"tick": reply["tick"], "resets": reply["resets"], "actions": actions}
            reply = post(f"{server}/v1/seats/{seat['seat']}/step", seat["token"], step)
    finally:  # also at Ctrl-C: the world would wait for a decision at each tick
        leave(server, seat)
    print(f"{name} has ended at tick {reply['tick']}", flush=True)


if __name__ == "__main__":
    main()
