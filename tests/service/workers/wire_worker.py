"""A worker by hand, for tests: sends what it is told, even nonsense, and remembers every byte it was sent."""

from __future__ import annotations

import json
import sys
import time
from http.client import HTTPConnection
from typing import Any

import msgspec

from tests.service.served import Service, wait_until

MSGPACK, JSON = "application/msgpack", "application/json"
AHEAD = [6.0, 0.0]  # what tests.evaluation.agents:Steady answers


class WireWorker:
    """One registered worker.

    Attributes:
        sent: Every byte of every answer it got.
    """

    def __init__(self, port: int, token: str, agent: str, media_type: str = MSGPACK, capacity: int = 1) -> None:
        self.media_type, self.sent = media_type, b""
        self._http = HTTPConnection("127.0.0.1", port, timeout=300)
        self.worker = self.token = ""
        status, answer = self.post("/v1/workers", {"agent": agent, "capacity": capacity}, token)
        assert status == 201, answer
        self.worker, self.token = answer["worker"], answer["token"]

    def post(self, path: str, document: Any = None, token: str | None = None, body: bytes | None = None) -> Any:
        """Status and document of the answer."""
        if body is None:
            encode = msgspec.msgpack.encode if self.media_type == MSGPACK else msgspec.json.encode
            body = encode(document if document is not None else {})
        headers = {"authorization": f"Bearer {token or self.token}", "content-type": self.media_type}
        self._http.request("POST", path, body, headers)
        response = self._http.getresponse()
        content = response.read()
        self.sent += content
        if not content:
            return response.status, None
        packed = MSGPACK in response.headers["content-type"]
        return response.status, msgspec.msgpack.decode(content) if packed else json.loads(content)

    def acquire(self, patience_s: float = 300.0) -> dict[str, Any]:
        """The next episode."""
        ends = time.monotonic() + patience_s
        while True:
            status, answer = self.post(f"/v1/workers/{self.worker}/acquire?wait=5")
            if status == 200:
                return dict(answer)
            assert status == 204, answer
            assert time.monotonic() < ends, "no episode came"

    def step(self, lease: str, tick: int, actions: Any) -> Any:
        """Status and reply."""
        return self.post(f"/v1/leases/{lease}/step", {"tick": tick, "actions": actions})

    def drive(self, episode: dict[str, Any], steps: int | None = None, action: Any = AHEAD) -> dict[str, Any]:
        """Drives ahead for so many steps, or to the end; returns the last answer."""
        reply = episode
        while steps is None or steps > 0:
            status, reply = self.step(episode["lease"], reply["tick"], dict.fromkeys(reply["observations"], action))
            assert status == 200, reply
            steps = steps - 1 if steps is not None else None
            if reply["done"]:
                break
        return reply

    def close(self) -> None:
        """Closes its connection, without a word."""
        self._http.close()


def hire(service: Service, agent: str = "steady", media_type: str = MSGPACK, capacity: int = 1) -> WireWorker:
    """Registers a worker at a service."""
    wait_until(service._listens, "no service")
    return WireWorker(service.port, service.token, agent, media_type, capacity)


def main() -> None:
    """Drives episodes of AGENT at PORT with TOKEN until it is killed; says so on standard output after ten steps."""
    worker = WireWorker(int(sys.argv[1]), sys.argv[2], sys.argv[3])
    while True:
        episode = worker.acquire(600.0)
        episode |= worker.drive(episode, steps=10)
        print("driving", flush=True)
        time.sleep(float(sys.argv[4]))
        worker.drive(episode)


if __name__ == "__main__":
    main()
