"""How fast live worlds are: `python -m tests.performance.worlds [--json FILE]`.

1. Ticks over loopback of a null simulation that 1, 4 and 16 workers have joined.
2. The same with 4 workers, alone and before 200 spectators.
3. A real world's tick with two workers, against one worker that drives both egos; and before 200 spectators.
4. A vector environment over the wire against processes of this machine.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import multiprocessing
import socket
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import uvloop

from dohyo.evaluation.benchmarks.environments import single_scenarios
from dohyo.service.client.connection import Connection
from dohyo.service.client.remote_env import RemoteEnv
from dohyo.service.wire.messages import pack
from dohyo.sumo_networks.envs.vector_env import VectorDrivingEnv
from tests.performance.wire import cpu_seconds, table_row
from tests.service.serving import serving

SPECTATORS = 200
SPECTATORS_JOIN_S = 5.0
STAND = pack(np.array([0.0, 0.0]))
NULL = "from dohyo.service.worlds import book; book.ENTRY = 'tests.performance.worlds:null_world'"
ACTORS = [[key, "car", 4.6, 1.8, 812.34, 977.41, 1.57] for key in range(100)]
SCENE = msgspec.json.encode({"tick": 0, "egos": [], "actors": ACTORS})


def null_world(file: int, _: int) -> None:
    """A world that computes nothing; in its process."""
    from dohyo.service.running.channel import Channel, Kind
    from dohyo.service.simulating.shown import SHOWN

    channel = Channel(socket.socket(fileno=file))
    tick, revision, egos, watched, next_s = 0, 0, [], False, 0.0
    while (frame := channel.receive()) is not None:
        kind, payload = frame
        if kind is Kind.ORDER:
            egos = [mission["name"] for mission in json.loads(payload)["scenario"]["missions"]]
            seen = {ego: {"vector": pack(np.zeros(100, np.float32))} for ego in egos}
            shown = {"driving": egos, "poses": dict.fromkeys(egos, [0.0] * 5), "observations": seen}
            body = msgspec.msgpack.encode(shown)
        elif kind is Kind.FAULT:
            channel.send(Kind.FINISHED, SHOWN.pack(tick, tick / 10, revision))
            continue
        elif kind is Kind.DRIVERS:
            revision = json.loads(payload)["revision"]
        elif kind is Kind.WATCH:
            watched = payload == b"\1"
            continue
        tick += kind is Kind.ACTIONS
        channel.send(Kind.SEEN, SHOWN.pack(tick, tick / 10, revision) + body)
        if watched and time.monotonic() > next_s:
            next_s = time.monotonic() + 0.1
            channel.send(Kind.SCENE, SCENE)


class Worker:
    """A worker that decides at once, always the same."""

    def __init__(self, served: Any, world: str, name: str, egos: Sequence[str]) -> None:
        asked = {"name": name, "egos": list(egos), "sensors": ["speedometer", "route"], "control": "lane_command"}
        seat = served.ask("POST", f"/v1/worlds/{world}/join", asked)
        self.path, self.token, self.tick = f"/v1/seats/{seat['seat']}/step", seat["token"], seat["tick"]
        self.http, self.actions = Connection(served.url), dict.fromkeys(egos, STAND)
        self.taken: list[float] = []

    def run(self, ticks: int) -> None:
        """Takes part in so many ticks."""
        for _ in range(ticks):
            began = time.perf_counter()
            reply = self.http.post(self.path, {"tick": self.tick, "actions": self.actions}, self.token)
            self.taken.append(time.perf_counter() - began)
            self.tick = reply["tick"]


def drive(workers: Sequence[Worker], ticks: int) -> dict[str, float]:
    """Ticks per second, and percentiles of a worker's wait for the next tick."""
    for worker in workers:
        worker.taken.clear()
    threads = [threading.Thread(target=worker.run, args=(ticks,)) for worker in workers]
    began = time.perf_counter()
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    rate = round(ticks / (time.perf_counter() - began), 1)
    return table_row([one for worker in workers for one in worker.taken]) | {"ticks_per_s": rate}


Make = Callable[[int, dict[str, Any], int], tuple[Any, str, list[Worker]]]
"""Makes a world, which so many workers have joined: its service, its identifier, and they."""


@contextmanager
def worlds(before: str = "") -> Iterator[Make]:
    """A service, in whose worlds workers drive."""
    with tempfile.TemporaryDirectory() as data, serving(Path(data) / "data", before=before) as served:

        def make(count: int, order: dict[str, Any], egos: int) -> tuple[Any, str, list[Worker]]:
            for old in served.ask("GET", "/v1/worlds")["items"]:
                if old["finished"] is None:
                    served.ask("POST", f"/v1/worlds/{old['id']}/end")
            world = served.ask("POST", "/v1/worlds", order)
            names = [ego["name"] for ego in world["egos"]][:egos]
            shares = [names[number::count] for number in range(count)]
            made = [Worker(served, world["id"], f"w-{number}", share) for number, share in enumerate(shares)]
            served.ask("POST", f"/v1/worlds/{world['id']}/resume")
            return served, world["id"], made

        yield make


def port_of(served: Any) -> int:
    """Port of a service."""
    return int(served.url.rpartition(":")[2])


def street(egos: int) -> dict[str, Any]:
    """Egos of a null world; nobody looks at where they are."""
    mission = {"start": {"lane": "737320747#3_2"}, "goal": {"lane": "737320747#4_2"}}
    missions = [mission | {"name": f"ego-{number}"} for number in range(egos)]
    return {"scenario": {"name": "null", "network": "ingolstadt", "missions": missions}}


class Spectator(asyncio.Protocol):
    """A connection that counts the bytes that it gets; cheap, so that the server's cost shows."""

    def __init__(self, request: bytes, counted: Any) -> None:
        self.request, self.counted = request, counted

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        transport.write(self.request)  # type: ignore[attr-defined]

    def data_received(self, data: bytes) -> None:
        self.counted.value += len(data)


def watch(port: int, token: str, world: str, counted: Any, stop: Any) -> None:
    """Spectators, in a process of their own."""
    request = f"GET /v1/worlds/{world}/events HTTP/1.1\r\nhost: a\r\nauthorization: Bearer {token}\r\n\r\n".encode()

    async def look() -> None:
        loop = asyncio.get_running_loop()
        for _ in range(SPECTATORS):
            await loop.create_connection(lambda: Spectator(request, counted), "127.0.0.1", port)
        while not stop.is_set():
            await asyncio.sleep(0.5)

    uvloop.run(look())


def alone_and_watched(served: Any, world: str, workers: Sequence[Worker], ticks: int) -> dict[str, float]:
    """The tick rate alone, before spectators, and the share that is left.

    The rates depend on what else the machine does; the server's processor time does not.
    """
    context = multiprocessing.get_context("spawn")
    drive(workers, ticks // 4)
    alone, alone_s = timed(served, workers, ticks)
    counted, stop = context.Value("q", 0, lock=False), context.Event()
    crowd = context.Process(target=watch, args=(port_of(served), served.token, world, counted, stop))
    crowd.start()
    time.sleep(SPECTATORS_JOIN_S)
    watched, watched_s = timed(served, workers, ticks)
    stop.set()
    crowd.join()
    return {
        "alone_ticks_per_s": alone,
        "watched_ticks_per_s": watched,
        "share": round(watched / alone, 3),
        "server_share_of_a_core": round((watched_s - alone_s) / (ticks / watched), 3),
        "megabytes": round(counted.value / 1e6, 1),
    }


def timed(served: Any, workers: Sequence[Worker], ticks: int) -> tuple[float, float]:
    """Ticks per second, and the server's processor time, s."""
    before = cpu_seconds(served.process.pid)
    return drive(workers, ticks)["ticks_per_s"], cpu_seconds(served.process.pid) - before


def measure_null(ticks: int) -> dict[str, Any]:
    """A null world by the number of its workers, and before spectators."""
    with worlds(NULL) as make:
        rows: dict[str, Any] = {}
        for count in (1, 4, 16):
            workers = make(count, street(16), 16)[2]
            drive(workers, ticks // 4)
            rows[f"{count} workers"] = drive(workers, ticks)
        rows["spectators"] = alone_and_watched(*make(4, street(16), 16), ticks)
        return rows


def measure_real(ticks: int) -> dict[str, Any]:
    """A world of the fleet by the number of its workers, and before spectators."""
    order = {"benchmark": "fleet", "mission": "ingolstadt", "seed": 0, "undriven": "stand"}
    with worlds() as make:
        rows: dict[str, Any] = {}
        for count in (1, 2):
            workers = make(count, order, 2)[2]
            rows[f"{count} workers"] = drive(workers, ticks)
        rows["two to one"] = round(rows["2 workers"]["p50_ms"] / rows["1 workers"]["p50_ms"], 3)
        rows["spectators"] = alone_and_watched(*make(2, order, 2), ticks)
        return rows


def measure_remote_env(steps: int, count: int = 2) -> dict[str, float]:
    """Steps per second of a vector environment over the wire, and of processes of this machine."""
    sensors, actions = ("speedometer", "route"), np.tile(np.float32([4.0, 0.0]), (count, 1))

    def rate(env: Any) -> float:
        env.reset(seed=list(range(count)))
        began = time.perf_counter()
        for _ in range(steps):
            env.step(actions)
        return round(count * steps / (time.perf_counter() - began), 1)

    local = VectorDrivingEnv(single_scenarios("quickstart")[:1], count, sensors=sensors)
    here = rate(local)
    local.close()
    with tempfile.TemporaryDirectory() as data, serving(Path(data) / "data") as served:
        remote = RemoteEnv(served.url, count, token=served.token, sensors=sensors)
        there = rate(remote)
        remote.close()
    return {"local_steps_per_s": here, "remote_steps_per_s": there, "ratio": round(there / here, 3)}


PARTS: dict[str, Callable[[], Any]] = {
    "null": lambda: measure_null(400),
    "real": lambda: measure_real(150),
    "vector": lambda: measure_remote_env(150),
}


def main() -> None:
    """Measures all, and prints it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--only", choices=[*PARTS], nargs="*", default=[*PARTS])
    chosen = parser.parse_args()
    found = {name: PARTS[name]() for name in chosen.only}
    print(json.dumps(found, indent=1))
    if chosen.json:
        chosen.json.write_text(json.dumps(found, indent=1))


if __name__ == "__main__":
    main()
