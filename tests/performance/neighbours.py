"""What attacks cost other tenants: the start of their evaluations and the answers to their reads, beside each attack.

    python -m tests.performance.neighbours [--rounds 5] [--only NAME ...] [--json FILE]

A service with two episode processes and default limits is attacked by another process. Meanwhile a second tenant reads,
and orders evaluations of `quickstart`, of which it cancels each once it runs. Times are wall-clock times, so the
machine should have nothing else to do. A start is the time from the order to the state `running`; the goal is 5 s,
and health answers within 1 s.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Final

import httpx
import numpy as np

from dohyo.service.accounts.model import Role
from dohyo.service.accounts.queries import create_token
from dohyo.service.client.client import Client
from dohyo.service.submissions.model import AgentKind
from tests.service.served import ROOT, STEADY, Service, info_of, short

GOING: Final = "going"
START_S, HEALTH_S = 5.0, 1.0
LOOKS: Final = 30
"""Reads beside each attack, at least."""
SPEC: Final = json.dumps({"track": "map", "sensors": ["speedometer"], "control": "target_speed_steering"})


def orders(http: httpx.Client) -> None:
    """Orders evaluations of hundreds of drives as long as there is room for them."""
    http.post("/v1/evaluations", json={"agent": "greedy", "benchmark": "nocrash", "seeds": list(range(5))})
    time.sleep(0.05)


def uploads(http: httpx.Client) -> None:
    """Uploads policies, each of which is checked in a process."""
    from tests.service.policies.models import identity

    files = {"spec": (None, SPEC), "file": ("policy.onnx", identity().SerializeToString())}
    http.post("/v1/agents/greedy/submissions/onnx", files=files)


def maps(http: httpx.Client) -> None:
    """Reads maps of boxes that nobody has asked for."""
    box = {"x0": -10_000.0 - time.monotonic(), "y0": -10_000, "x1": 10_000, "y1": 10_000}
    http.get("/v1/networks/ingolstadt/map", params=box)


def tables(http: httpx.Client) -> None:
    """Reads boards and lists."""
    for path in ("/v1/leaderboard?benchmark=short", "/v1/evaluations?limit=100", "/v1/metrics"):
        http.get(path)


def streams(http: httpx.Client) -> None:
    """Opens streams of events, and leaves them open for a while."""
    with ExitStack() as opened:
        for _ in range(100):
            opened.enter_context(http.stream("GET", "/v1/evaluations/events"))
        time.sleep(1.0)


FLOODS: Final[dict[str, Callable[[httpx.Client], None]]] = {
    "orders": orders,
    "uploads": uploads,
    "maps": maps,
    "tables": tables,
    "streams": streams,
}
QUIET, SLOW = "nobody", "slow connections"
ATTACKS: Final = (QUIET, *FLOODS, SLOW)


@dataclass(frozen=True)
class Row:
    """What a tenant saw beside one attack.

    Attributes:
        attack: Its name.
        starts_s: Times until an ordered evaluation ran, s.
        slowest_health_s: Longest time until `/health/live` answered, s.
        reads_p95_ms: 95th percentile of the time of `GET /v1/me`, ms.
    """

    attack: str
    starts_s: list[float]
    slowest_health_s: float
    reads_p95_ms: float

    @property
    def line(self) -> str:
        """A line of the table."""
        met = max(self.starts_s) <= START_S and self.slowest_health_s <= HEALTH_S
        median, worst = float(np.median(self.starts_s)), max(self.starts_s)
        return (
            f"{self.attack:<18}{median:>10.2f}{worst:>10.2f}{self.slowest_health_s:>12.2f}{self.reads_p95_ms:>14.1f}"
            f"   {'yes' if met else 'no'}"
        )


def attack(name: str, url: str, token: str) -> None:
    """Attacks until this process is ended."""
    if name == SLOW:
        from tests.service.web.test_connections import Dripping, mixed

        dripping = Dripping(url, mixed)
        print(GOING, flush=True)
        while True:
            dripping.drip()
            time.sleep(0.2)
    headers, limits = {"authorization": f"Bearer {token}"}, httpx.Limits(max_connections=40)
    with httpx.Client(base_url=url, headers=headers, timeout=60.0, limits=limits) as http:

        def flood() -> None:
            while True:
                with suppress(httpx.TransportError):
                    FLOODS[name](http)

        with ThreadPoolExecutor(40) as threads:
            for _ in range(40):
                threads.submit(flood)
            print(GOING, flush=True)


@contextmanager
def attacked(service: Service, name: str, token: str) -> Iterator[None]:
    """A process attacks meanwhile."""
    if name == QUIET:
        yield
        return
    command = [sys.executable, "-m", "tests.performance.neighbours", "--attack", name, service.url, token]
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            assert process.stdout.readline().strip() == GOING
            time.sleep(2.0)
            yield
            assert process.poll() is None, "the attack has ended"
        finally:
            process.kill()


def measure(service: Service, name: str, tokens: dict[str, str], rounds: int) -> Row:
    """Orders and reads of the second tenant beside one attack."""
    stop, health, reads = threading.Event(), list[float](), list[float]()
    mine = {"authorization": f"Bearer {tokens['tenant']}"}
    with attacked(service, name, tokens["greedy"]), httpx.Client(base_url=service.url, timeout=60.0) as http:

        def look() -> None:
            with httpx.Client(base_url=service.url, timeout=60.0) as other:
                while not (stop.wait(0.1) and len(reads) >= LOOKS):
                    health.append(_seconds(lambda: other.get("/health/live").raise_for_status()))
                    reads.append(_seconds(lambda: other.get("/v1/me", headers=mine).raise_for_status()))

        looking = threading.Thread(target=look)
        looking.start()
        try:
            starts = [_start_s(http, mine) for _ in range(rounds)]
        finally:
            stop.set()
            looking.join()
    return Row(name, starts, max(health), 1000 * float(np.percentile(reads[1:], 95)))


def _seconds(call: Callable[[], object]) -> float:
    began = time.perf_counter()
    call()
    return time.perf_counter() - began


def _start_s(http: httpx.Client, headers: dict[str, str]) -> float:
    """Seconds from an order until its drive runs; returns once it has ended."""
    began = time.perf_counter()
    order = {"agent": "modest", "benchmark": "quickstart", "seeds": [0]}
    answer = http.post("/v1/evaluations", json=order, headers=headers)
    assert answer.is_success, answer.text
    path = f"/v1/evaluations/{answer.json()['id']}"
    while http.get(path, headers=headers).raise_for_status().json()["status"] == "queued":
        time.sleep(0.1)
    seconds = time.perf_counter() - began
    http.post(f"{path}/cancel", headers=headers)
    return seconds


def prepared(folder: Path) -> tuple[Service, dict[str, str]]:
    """A running service with an agent of each tenant, and their tokens."""
    service = Service(folder, processes=2)
    service.start()
    with service.database.session() as session:
        tokens = {owner: create_token(session, owner, Role.SUBMITTER)[1] for owner in ("tenant", "greedy")}
    warm = service.submit(info_of(STEADY), short(), kind=AgentKind.BUILTIN)
    service.wait(warm)  # the first drive of a service starts its processes
    for owner, agent in (("tenant", "modest"), ("greedy", "greedy")):
        with Client(service.url, tokens[owner]) as client:
            client.register_agent(agent)
            client.submit_builtin(agent, "autopilot")
    return service, tokens


def main() -> int:
    """Prints a row for each attack; the exit code is 1 where a goal was missed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--only", nargs="+", choices=ATTACKS, default=ATTACKS)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--attack", nargs=3, metavar=("NAME", "URL", "TOKEN"), help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.attack:
        attack(*options.attack)
    print(f"{'attack':<18}{'start, s':>10}{'worst':>10}{'health, s':>12}{'read p95, ms':>14}   met")
    rows = []
    for name in options.only:
        with tempfile.TemporaryDirectory() as folder:
            service, tokens = prepared(Path(folder))
            try:
                rows.append(measure(service, name, tokens, options.rounds))
            finally:
                service.close()
        print(rows[-1].line, flush=True)
    if options.json:
        options.json.write_text(json.dumps([asdict(row) for row in rows], indent=1) + "\n")
    return int(any(row.line.endswith("no") for row in rows))


if __name__ == "__main__":
    sys.exit(main())
