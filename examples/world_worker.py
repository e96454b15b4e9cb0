"""A worker that joins a world of a dohyo service and drives one ego; it needs nothing but Python.

    python world_worker.py http://127.0.0.1:8000 TOKEN WORLD NAME EGO 8.0

The last argument is the speed to keep, m/s. Ctrl-C leaves the world. After a crash, who is started again by the same
NAME takes the place back.
"""

from __future__ import annotations

import contextlib
import http.client
import json
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Callable
from typing import Any

PATIENCE_S = 120.0


def post(url: str, token: str, document: dict[str, Any]) -> dict[str, Any]:
    """Posts a document and returns the answer."""
    return _answer(url, token, json.dumps(document).encode())


def get(url: str, token: str) -> dict[str, Any]:
    """Reads a document."""
    return _answer(url, token)


def _answer(url: str, token: str, body: bytes | None = None) -> dict[str, Any]:
    """The answer to a request, which is sent again while the service answers "not now"."""
    headers = {"Authorization": f"Bearer {token}", "Content-Type": "application/json"}
    while True:
        try:
            request = urllib.request.Request(url, body, headers)
            with urllib.request.urlopen(request, timeout=PATIENCE_S) as answer:
                return dict(json.load(answer))
        except urllib.error.HTTPError as error:
            text = error.read().decode(errors="replace")
            problem = json.loads(text) if "json" in error.headers.get("Content-Type", "") else {}
            if "expected_resets" in problem:  # the world began anew meanwhile: what the place observes now
                url, body = url.removesuffix("/step"), None
            elif error.code in (429, 503):
                time.sleep(float(error.headers.get("Retry-After", "1")))
            else:
                sys.exit(f"{error.code}: {problem.get('detail', text[:200])}")
        except (OSError, http.client.HTTPException, ValueError) as error:  # also for what is no address
            sys.exit(f"no answer from {url}: {getattr(error, 'reason', error)}")


def leave(server: str, seat: dict[str, Any]) -> None:
    """Leaves a world, which then waits for this place no more. One that has ended, or is lost, needs nothing."""
    url, headers = f"{server}/v1/seats/{seat['seat']}/leave", {"Authorization": f"Bearer {seat['token']}"}
    with contextlib.suppress(OSError):  # an answer of the service, too
        urllib.request.urlopen(urllib.request.Request(url, b"{}", headers), timeout=10.0).close()


def told(*usages: str) -> list[str]:
    """Arguments of this program, which ends with its usage if they are not as many; an address may end in a slash."""
    given = [one.rstrip("/") for one in sys.argv[1:]]
    if len(given) not in [len(usage.split()) for usage in usages]:
        sys.exit("\n".join(f"usage: python {sys.argv[0]} {usage}" for usage in usages))
    return given


def speed_of(text: str) -> float:
    """A speed that was told, m/s."""
    try:
        return float(text)
    except ValueError:
        sys.exit(f"expected a speed in m/s, got '{text}'")


def run(program: Callable[[], None]) -> None:
    """Runs a program, which Ctrl-C ends without a traceback."""
    try:
        program()
    except KeyboardInterrupt:
        sys.exit("ended by Ctrl-C")


def decide(observation: dict[str, Any], speed_mps: float) -> list[float]:
    """Target speed and change of lane: a little faster than now, up to the speed to keep."""
    return [min(speed_mps, observation["speedometer"][0] + 0.5), 0.0]


def main() -> None:
    """Joins a world, and drives until its ego has ended its drive."""
    server, token, world, name, ego, speed = told("SERVER TOKEN WORLD NAME EGO SPEED")
    speed_mps = speed_of(speed)
    asked = {"name": name, "egos": [ego], "sensors": ["speedometer"], "control": "lane_command"}
    seat = post(f"{server}/v1/worlds/{world}/join", token, asked)
    print(f"{name} drives {ego} from tick {seat['tick']}", flush=True)
    reply: dict[str, Any] = seat | {"done": False}
    try:
        while not reply["done"]:
            actions = {ego: decide(seen, speed_mps) for ego, seen in reply["observations"].items()}
            step = {"tick": reply["tick"], "resets": reply["resets"], "actions": actions}
            reply = post(f"{server}/v1/seats/{seat['seat']}/step", seat["token"], step)
    finally:  # also at Ctrl-C: the world would wait for a decision at each tick
        leave(server, seat)
    print(f"{name} has ended at tick {reply['tick']}", flush=True)


if __name__ == "__main__":
    run(main)
