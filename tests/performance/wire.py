"""How fast the wire is: `python tests/performance/wire.py [--json FILE] [--quick]`.

1. Steps over loopback against a null simulation, 12 kB each way, through the whole service: one worker, then 32.
2. The same bytes through a bare ASGI application on uvicorn, in the same run: what HTTP alone costs on this machine.
3. A real episode locally and through the service: the share of a tick that HTTP costs.
4. The same real episode's steps alone, and while 200 readers look at the service.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import multiprocessing
import os
import socket
import sys
import tempfile
import threading
import time
from collections.abc import Sequence
from http.client import HTTPConnection
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT))

from dohyo.evaluation.agent import make_agent  # noqa: E402
from dohyo.evaluation.benchmarks.benchmark import load_benchmark  # noqa: E402
from dohyo.evaluation.episode.runner import run_episode  # noqa: E402
from dohyo.evaluation.records.record import AgentInfo  # noqa: E402
from dohyo.service.settings import Settings  # noqa: E402
from dohyo.service.wire.messages import Format, decode, encode, encode_observations, pack  # noqa: E402
from dohyo.sumo_networks.scenario import Mission, Place, Scenario  # noqa: E402

BODY = {"vector": np.zeros(3000, np.float32)}  # 12 kB
PORT_WAIT_S = 60.0
READERS, READ_EVERY_S = 200, 5.0


def null_episode(file: int, _: int) -> None:
    """Answers every action with 12 kB, and never ends; in an episode process."""
    from dohyo.service.running.channel import SEEN, Channel, Kind

    channel = Channel(socket.socket(fileno=file))
    seen, tick = encode_observations({"ego": BODY}), 0
    while (frame := channel.receive()) is not None:
        if frame[0] is Kind.ACTIONS:
            tick += 1
        if frame[0] in (Kind.ACTIONS, Kind.ORDER):
            channel.send(Kind.SEEN, SEEN.pack(tick, tick / 10, 0, 0) + seen)


def serve_null(data: str, port: int, episodes: int) -> None:
    """A service whose every episode is a null episode."""
    from sqlalchemy.orm import Session

    from dohyo.service import server
    from dohyo.service.accounts.model import Role
    from dohyo.service.accounts.queries import create_token
    from dohyo.service.app import create_app
    from dohyo.service.database.base import new_id
    from dohyo.service.running.order import EpisodeOrder
    from dohyo.service.running.process import EpisodeProcess
    from dohyo.service.scheduling.scheduler import Scheduler
    from dohyo.service.submissions.model import Agent
    from dohyo.service.workers.lease import RemoteEpisode

    class NullScheduler(Scheduler):
        async def start(self) -> None:
            await super().start()

            def enrol(session: Session) -> str:
                session.add(Agent(id=new_id("ag"), name="null", owner="owner"))
                return create_token(session, "owner", Role.WORKER)[1]

            token = await self._database.change(enrol)
            place = Place(lane="a_0")
            info = AgentInfo(name="null", entry="n", track="map", sensors=("route",), control="waypoints")
            self.kept = []
            for _ in range(episodes):
                process = EpisodeProcess(Path(data), "tests.performance.wire:null_episode")
                await process.start()
                order = EpisodeOrder(
                    scenario=Scenario(network="n", missions=(Mission(start=place, goal=place),)),
                    info=info,
                    benchmark=("n", ""),
                    directory=Path(data),
                    stem="n",
                    act_deadline_s=60,
                    remote=True,
                )
                self.leases.expect(RemoteEpisode("null", 1, 1, order, process))
                self.kept.append(asyncio.create_task(process.drive(order)))
            Path(data, "token").write_text(token)

    settings = Settings(data=Path(data), port=port, drain_s=0.0)
    app = create_app(settings, NullScheduler)
    with server.listen(settings) as own:
        server.DrainingServer(server.configuration(settings, app), app.state.services).run(sockets=[own])


def serve_echo(port: int) -> None:
    """A bare ASGI application that answers every request with its body, on the service's server and event loop."""
    import uvicorn

    async def echo(scope: Any, receive: Any, send: Any) -> None:
        body, more = b"", True
        while more:
            message = await receive()
            body, more = body + message.get("body", b""), message.get("more_body", False)
        about = [(b"content-type", b"application/msgpack"), (b"content-length", str(len(body)).encode())]
        await send({"type": "http.response.start", "status": 200, "headers": about})
        await send({"type": "http.response.body", "body": body})

    uvicorn.run(echo, port=port, log_level="critical", access_log=False, lifespan="off")


def measure_echo(steps: int) -> dict[str, float]:
    """Round trips of one client to the bare application, with a step's body both ways."""
    port = free_port()
    server = multiprocessing.get_context("spawn").Process(target=serve_echo, args=(port,))
    server.start()
    try:
        wait_for(ROOT, port)
        http, taken = HTTPConnection("127.0.0.1", port, timeout=60), []
        body = encode({"tick": 0, "actions": {"ego": pack(BODY["vector"])}}, Format.MSGPACK)
        for _ in range(steps):
            began = time.perf_counter()
            http.request("POST", "/", body, {"content-type": Format.MSGPACK.value})
            http.getresponse().read()
            taken.append(time.perf_counter() - began)
    finally:
        server.terminate()
        server.join()
    return table_row(taken)


class Stepper:
    """One worker that steps as fast as it can."""

    def __init__(self, port: int, token: str, agent: str) -> None:
        self.http = HTTPConnection("127.0.0.1", port, timeout=60)
        registered = self.post("/v1/workers", {"agent": agent}, token)
        self.token = registered["token"]
        self.episode: Any = None
        while self.episode is None:
            self.episode = self.post(f"/v1/workers/{registered['worker']}/acquire?wait=20", {}, self.token)
        self.tick = self.episode["tick"]

    def post(self, path: str, document: Any, token: str) -> Any:
        """One request."""
        headers = {"authorization": f"Bearer {token}", "content-type": Format.MSGPACK.value}
        self.http.request("POST", path, encode(document, Format.MSGPACK), headers)
        response = self.http.getresponse()
        body = response.read()
        assert response.status < 300, body
        return decode(body, Format.MSGPACK) if body else None

    def run(self, steps: int, actions: Any) -> list[float]:
        """Seconds of each round trip, encoding left out, or until the episode is done."""
        path, taken = f"/v1/leases/{self.episode['lease']}/step", []
        headers = {"authorization": f"Bearer {self.token}", "content-type": Format.MSGPACK.value}
        for _ in range(steps):
            body = encode({"tick": self.tick, "actions": actions}, Format.MSGPACK)
            began = time.perf_counter()
            self.http.request("POST", path, body, headers)
            answer = self.http.getresponse().read()
            taken.append(time.perf_counter() - began)
            reply = decode(answer, Format.MSGPACK)
            self.tick = reply["tick"]
            if reply["done"]:
                break
        return taken


def step_many(port: int, token: str, workers: int, steps: int, results: Any) -> None:
    """Workers in threads of one process."""
    steppers = [Stepper(port, token, "null") for _ in range(workers)]
    lists: list[list[float]] = [[] for _ in steppers]
    actions = {"ego": pack(BODY["vector"])}

    def go(i: int) -> None:
        lists[i] = steppers[i].run(steps, actions)

    threads = [threading.Thread(target=go, args=(i,)) for i in range(workers)]
    began = time.perf_counter()
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    results.put((time.perf_counter() - began, [one for many in lists for one in many]))


def measure_null(workers: int, steps: int) -> dict[str, float]:
    """Round trips of so many workers at once."""
    context = multiprocessing.get_context("spawn")
    with tempfile.TemporaryDirectory() as data:
        port = free_port()
        server = context.Process(target=serve_null, args=(data, port, workers))
        server.start()
        try:
            wait_for(Path(data, "token"), port)
            token, results = Path(data, "token").read_text(), context.Queue()
            per = min(workers, 8)
            crews = [
                context.Process(target=step_many, args=(port, token, per, steps, results))
                for _ in range(workers // per)
            ]
            for crew in crews:
                crew.start()
            before = cpu_seconds(server.pid)
            got = [results.get(timeout=300) for _ in crews]
            used = cpu_seconds(server.pid) - before
            for crew in crews:
                crew.join()
        finally:
            server.terminate()
            server.join()
    taken = [one for _, many in got for one in many]
    rate = round(len(taken) / max(seconds for seconds, _ in got))
    # CPU time tells more than a clock does on a machine with other work to do.
    return table_row(taken) | {"steps_per_s": rate, "server_cpu_us": round(1e6 * used / len(taken))}


def measure_real(quick: bool) -> dict[str, Any]:
    """A real episode here and through the service, and what readers do to its steps."""
    from tests.service.served import STEADY, Service, info_of

    benchmark = load_benchmark("quickstart")
    one = benchmark.model_copy(update={"missions": {"all": benchmark.missions["all"][2:3]}})
    info = info_of(STEADY)
    scenario = one.scenarios([0])[0]
    run_episode(scenario, {"ego": make_agent(STEADY)})
    began = time.perf_counter()
    local = run_episode(scenario, {"ego": make_agent(STEADY)})
    tick_ms = (time.perf_counter() - began) / local.ticks * 1000
    context = multiprocessing.get_context("spawn")
    with tempfile.TemporaryDirectory() as data:
        service = Service(Path(data), processes=1, requests_per_minute=1_000_000, lease_ttl_s=60)
        service.start()
        try:
            shown = service.submit(info_of("dohyo.agents.experts.autopilot:Autopilot"), one, kind=_builtin())
            service.wait(shown)
            rounds = 1 if quick else 3
            alone = [_drive(service, info, one) for _ in range(rounds)]
            stop = context.Event()
            readers = context.Process(target=read, args=(service.url, shown, stop))
            readers.start()
            time.sleep(READ_EVERY_S)
            watched = [_drive(service, info, one) for _ in range(rounds)]
            stop.set()
            readers.join()
        finally:
            service.close()
    quiet, busy = (table_row([t for many in runs for t in many]) for runs in (alone, watched))
    mean = 1000 * float(np.mean([t for many in alone for t in many]))
    return {
        "local_tick_ms": round(tick_ms, 3),
        "remote_step_ms": round(mean, 3),
        "http_share": round(1 - tick_ms / mean, 3),
        "alone": quiet,
        f"with_{READERS}_readers": busy,
        "p99_ratio": round(busy["p99_ms"] / quiet["p99_ms"], 2),
    }


def _builtin() -> Any:
    from dohyo.service.submissions.model import AgentKind

    return AgentKind.BUILTIN


def _drive(service: Any, info: AgentInfo, benchmark: Any) -> list[float]:
    service.submit(info, benchmark)
    stepper = Stepper(service.port, service.token, info.name)
    stepper.run(20, {"ego": [6.0, 0.0]})
    return stepper.run(100_000, {"ego": [6.0, 0.0]})[:-1]  # the last one waits for the record's fsync


def read(url: str, evaluation: str, stop: Any) -> None:
    """Readers of pages and of the interface, each at its own pace."""
    import httpx

    pages = ("/v1/leaderboard?benchmark=quickstart", f"/v1/evaluations/{evaluation}", f"/evaluations/{evaluation}", "/")

    async def look(http: httpx.AsyncClient, number: int) -> None:
        await asyncio.sleep(READ_EVERY_S * number / READERS)
        while not stop.is_set():
            answer = await http.get(pages[number % len(pages)])
            assert answer.status_code == 200, answer
            await asyncio.sleep(READ_EVERY_S)

    async def main() -> None:
        limits = httpx.Limits(max_connections=READERS, max_keepalive_connections=READERS)
        async with httpx.AsyncClient(base_url=url, limits=limits, timeout=30) as http:
            await asyncio.gather(*(look(http, number) for number in range(READERS)))

    asyncio.run(main())


def table_row(seconds: Sequence[float]) -> dict[str, float]:
    """Percentiles in ms."""
    p50, p99 = np.percentile(np.array(seconds) * 1000, [50, 99])
    return {"p50_ms": round(float(p50), 3), "p99_ms": round(float(p99), 3), "steps": len(seconds)}


def cpu_seconds(pid: int | None) -> float:
    """User and system time of a process so far."""
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def free_port() -> int:
    """A port that nobody uses."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def wait_for(file: Path, port: int) -> None:
    """Waits until a service is ready."""
    ends = time.monotonic() + PORT_WAIT_S
    while time.monotonic() < ends:
        with socket.socket() as probe:
            if file.exists() and probe.connect_ex(("127.0.0.1", port)) == 0:
                return
        time.sleep(0.1)
    raise SystemExit("the service does not start")


def main() -> None:
    """Measures and prints."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])  # type: ignore[union-attr]
    parser.add_argument("--json", type=Path, help="write the numbers here as well")
    parser.add_argument("--quick", action="store_true", help="a tenth of the steps")
    options = parser.parse_args()
    steps = 1000 if options.quick else 10_000
    load, null, echo = os.getloadavg()[0], measure_null(1, steps), measure_echo(steps)
    numbers = {
        "load_before": load,
        "null_1_worker": null,
        "echo": echo,
        "null_to_echo": {"p50": round(null["p50_ms"] / echo["p50_ms"], 2)},
        "null_32_workers": measure_null(32, max(100, steps // 32)),
        "real": measure_real(options.quick),
    }
    for name, row in numbers.items():
        print(f"{name:18}", json.dumps(row))
    if options.json:
        options.json.write_text(json.dumps(numbers, indent=1) + "\n")


if __name__ == "__main__":
    main()
