"""How fast a service with ten thousand ranked and ten thousand mixed runs answers its reads over HTTP.

    python -m tests.performance.reads [--ranked 10000] [--mixed 10000] [--reads 200] [--sqlite] [--json FILE]

The ranked runs are on one board, each with a place of its own, and a tenth as many on another. A run has 48 episodes,
of eight egos in mixed runs. The service is the real one, in a process of its own, on PostgreSQL unless `--sqlite`; a
submitter reads through one connection. "After one more run" means that a run ended since the last read. "Processor"
is the mean processor time of the service and PostgreSQL for one read: about its duration on cores without other work.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from http.client import HTTPConnection
from pathlib import Path
from typing import Any, Final

import numpy as np
from sqlalchemy import text

from tests.performance.many_evaluations import ManyEvaluations
from tests.service import postgres
from tests.service.served import Service
from tests.service.tables import postgresql_with_tables

GOAL_MS: Final = 100.0
AFTER_ONE_MORE: Final = 20
"""Reads of which each needs a new run first."""
UNLIMITED: Final = 10**9


@dataclass(frozen=True)
class Row:
    """Answers to one read, in ms.

    Attributes:
        read: What was read.
        count: How often.
        p50_ms: Median.
        p95_ms: 95th percentile.
        p99_ms: 99th percentile.
        processor_ms: Mean processor time of the service and its database server.
        kilobytes: Size of the last answer.
    """

    read: str
    count: int
    p50_ms: float
    p95_ms: float
    p99_ms: float
    processor_ms: float
    kilobytes: float

    @property
    def met(self) -> bool:
        """Whether the goal is met."""
        return self.p95_ms <= GOAL_MS

    @property
    def line(self) -> str:
        """A line of the table."""
        times = "".join(f"{value:>9.1f}" for value in (self.p50_ms, self.p95_ms, self.p99_ms))
        rest = f"{self.processor_ms:>11.1f}{self.kilobytes:>9.1f}"
        return f"{self.read:<44}{self.count:>6}{times}{rest}   {'yes' if self.met else 'no'}"


class Processor:
    """Processor time of a running service and its database server."""

    def __init__(self, service: Service) -> None:
        assert service.process is not None
        self._service = service.process.pid
        self._server: int | None = None
        if not service.database.is_sqlite:
            with service.database.reading() as session:
                backend = session.scalar(text("SELECT pg_backend_pid()"))
            self._server = int(Path(f"/proc/{backend}/stat").read_text().rpartition(")")[2].split()[1])

    def used_ms(self) -> float:
        """Time since the processes began."""
        backends = (
            []
            if self._server is None
            else Path(f"/proc/{self._server}/task/{self._server}/children").read_text().split()
        )
        return sum(_thread_times_ms(process) for process in (self._service, *map(int, backends)))


def _thread_times_ms(process: int) -> float:
    return sum(int(one.read_text().split()[0]) for one in Path(f"/proc/{process}/task").glob("*/schedstat")) / 1e6


class Reader:
    """A submitter with one connection to a service."""

    def __init__(self, service: Service) -> None:
        self._processor = Processor(service)
        self._connection = HTTPConnection("127.0.0.1", service.port, timeout=600.0)
        self._headers = {"authorization": f"Bearer {service.submitter_token}"}

    def read(self, path: str) -> bytes:
        """The answer to a GET."""
        self._connection.request("GET", path, headers=self._headers)
        answer = self._connection.getresponse()
        content = answer.read()
        if answer.status != 200:
            raise RuntimeError(f"{path} answered {answer.status}: {content[:300]!r}")
        return content

    def measure(self, name: str, path: str, count: int, before: Callable[[], None] = lambda: None) -> Row:
        """Reads a path so many times, each time after `before`."""
        times, processor_ms, content = list[float](), 0.0, b""
        for _ in range(count):
            before()
            used_ms, began = self._processor.used_ms(), time.perf_counter()
            content = self.read(path)
            times.append(1000 * (time.perf_counter() - began))
            processor_ms += self._processor.used_ms() - used_ms
        p50, p95, p99 = (float(value) for value in np.percentile(times, (50, 95, 99)))
        return Row(name, count, p50, p95, p99, processor_ms / count, len(content) / 1000)


def measure(service: Service, data: ManyEvaluations, reads: int) -> Iterator[Row]:
    """All reads, the first ones of a fresh process before the others."""
    reader = Reader(service)
    board, fleet = f"/v1/leaderboard?benchmark={data.board.name}", f"/v1/leaderboard?benchmark={data.fleet.name}"
    cross_play, runs = f"/v1/benchmarks/{data.fleet.name}/cross-play", "/v1/evaluations"
    yield reader.measure("board of the largest benchmark, first of all", board, 1)
    yield reader.measure("cross-play, first of all", cross_play, 1)
    middle = json.loads(reader.read(f"{runs}?limit=1&ranking={_ranking(reader, board)}"))["items"][0]["id"]
    places = _places(reader, board)
    paths = {
        "board, 100 of the largest benchmark's places": board,
        "board, the last 100 places": f"{board}&after={places[-101]}",
        "board, one track": f"{board}&track=privileged",
        "board of another benchmark": fleet,
        "cross-play": cross_play,
        "list of evaluations": runs,
        "list of evaluations, far back": f"{runs}?after={places[0]}",
        "list of evaluations of one agent": f"{runs}?agent=mixed7",
        "list of evaluations of one benchmark": f"{runs}?benchmark={data.board.name}",
        "list of evaluations that are done": f"{runs}?status=done",
        "list of running evaluations": f"{runs}?status=running",
        "one evaluation": f"{runs}/{middle}",
        "episodes of one evaluation": f"{runs}/{middle}/episodes",
        "metrics of one evaluation": f"{runs}/{middle}/metrics",
    }
    for name, path in paths.items():
        yield reader.measure(name, path, reads)
    more = min(reads, AFTER_ONE_MORE)
    yield reader.measure("board, after one more run", board, more, lambda: data.add(data.board, 1, stored=False))
    yield reader.measure(
        "cross-play, after one more run", cross_play, more, lambda: data.add(data.fleet, 1, mixed=True)
    )


def _ranking(reader: Reader, board: str) -> str:
    return str(json.loads(reader.read(f"{board}&limit=1"))["ranking"]["id"])


def _places(reader: Reader, board: str) -> list[str]:
    """Evaluations of the whole board, in its order."""
    table = reader.read(board.replace("leaderboard?", "leaderboard.csv?")).decode().splitlines()
    column = table[0].split(",").index("evaluation")
    return [line.split(",")[column] for line in table[1:]]


def main() -> int:
    """Prints a row for each read; the exit code is 1 where the goal was missed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--ranked", type=int, default=10_000)
    parser.add_argument("--mixed", type=int, default=10_000)
    parser.add_argument("--reads", type=int, default=200)
    parser.add_argument("--sqlite", action="store_true")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        settings: dict[str, Any] = dict.fromkeys(("requests_per_minute", "read_seconds_per_minute"), UNLIMITED)
        if not options.sqlite:
            settings["database"] = postgresql_with_tables(stack.enter_context(postgres.running()))
        service = Service(folder, processes=1, **settings)
        stack.callback(service.close)
        began = time.perf_counter()
        data = ManyEvaluations(service.database, service.settings)
        data.fill(options.ranked, options.mixed)
        print(f"{data.runs} evaluations made in {time.perf_counter() - began:.0f} s", flush=True)
        service.start()
        print(
            f"{'read':<44}{'times':>6}{'p50, ms':>9}{'p95':>9}{'p99':>9}{'processor':>11}{'kB':>9}"
            f"   p95 <= {GOAL_MS:g} ms"
        )
        rows = []
        for row in measure(service, data, options.reads):
            rows.append(row)
            print(row.line, flush=True)
    if options.json:
        options.json.write_text(json.dumps([asdict(row) for row in rows], indent=1) + "\n")
    return int(not all(row.met for row in rows))


if __name__ == "__main__":
    sys.exit(main())
