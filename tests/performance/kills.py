"""Campaign of kills: many kill -9 at random moments over a server, its episode processes and its policy workers.

    python -m tests.performance.kills [--kills 100] [--database sqlite postgresql] [--seed 0] [--json FILE]

Evaluations of a built-in and of a remote agent are queued without end while processes are killed. Then all of them
must end, and: what was finished at any kill is unchanged; every episode has one record, of the hash that a drive
without any kill has; and no episode was ended twice. A remote episode that two dead workers left is its agent's loss,
and must say so.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from http.client import HTTPException
from pathlib import Path
from typing import Any, Final

from dohyo.evaluation.agent import make_agent
from dohyo.evaluation.episode.runner import run_episode
from dohyo.evaluation.records.record import AgentInfo
from dohyo.service.evaluations.model import EpisodeStatus, EvaluationStatus
from dohyo.service.submissions.model import AgentKind
from tests.service import postgres
from tests.service.served import ROOT, Service, info_of, short, wait_until
from tests.service.tables import postgresql_with_tables
from tests.service.workers.wire_worker import WireWorker

AGENT: Final = "tests.evaluation.agents:Slow"
MISSIONS: Final = 4
TARGETS: Final = {"server": 0.2, "episode": 0.5, "worker": 0.3}
"""What is killed, and how often."""
PAUSE_S: Final = 1.5
"""Mean time between two kills; they come at random, as a Poisson process."""
END_S: Final = 600.0


@dataclass(frozen=True)
class Result:
    """One campaign.

    Attributes:
        database: Kind of the database.
        kills: By what was killed.
        evaluations: Number of evaluations.
        episodes: Number of episodes.
        attempts: By outcome.
        lost_by_workers: Remote episodes that two dead workers left.
        faults: What should not be, in words.
        seconds: Length of the campaign, s.
    """

    database: str
    kills: dict[str, int]
    evaluations: int
    episodes: int
    attempts: dict[str, int]
    lost_by_workers: int
    faults: list[str]
    seconds: float


class Campaign:
    """A service under load whose processes are killed."""

    def __init__(self, service: Service, seed: int) -> None:
        self._service, self._random = service, random.Random(seed)
        self._infos = {kind: _info(kind.value) for kind in (AgentKind.BUILTIN, AgentKind.REMOTE)}
        self._evaluations: dict[str, AgentKind] = {}
        self._finished: dict[str, tuple[str | None, Any]] = {}
        self._workers: list[subprocess.Popen[bytes]] = []
        self.kills: Counter[str] = Counter()
        self.faults: list[str] = []

    def run(self, kills: int) -> None:
        """Kills so many processes, and waits for the end of all evaluations."""
        self._service.start()
        try:
            while self.kills.total() < kills:
                self._keep_busy()
                time.sleep(self._random.expovariate(1.0 / PAUSE_S))
                self._kill(self._random.choices(list(TARGETS), list(TARGETS.values()))[0])
            self._keep_busy()
            wait_until(self._ended, "not every evaluation ends", END_S)
        finally:
            for worker in self._workers:
                worker.kill()
                worker.wait()
        self._compare()

    def result(self, database: str, seconds: float) -> Result:
        """The campaign in numbers; every fault in words."""
        expected = {kind: _undisturbed(info) for kind, info in self._infos.items()}
        outcomes: Counter[str] = Counter()
        lost = episodes = 0
        for evaluation, kind in self._evaluations.items():
            if self._service.evaluation(evaluation).status is not EvaluationStatus.DONE:
                self.faults.append(f"{evaluation} ended as {self._service.evaluation(evaluation).status}")
                continue
            attempts = self._service.attempts(evaluation)
            outcomes.update(str(one.outcome) for one in attempts)
            for episode in self._service.episodes(evaluation):
                episodes += 1
                mine = [one for one in attempts if one.episode_id == episode.id]
                done = sum(one.outcome == "done" for one in mine)
                if sum(one.charged for one in mine) >= 2 and kind is AgentKind.REMOTE and done == 0:
                    lost += 1
                elif episode.record_hash != expected[kind][episode.position]:
                    self.faults.append(f"{episode.id} has another record than undisturbed")
                elif done != 1:
                    self.faults.append(f"{episode.id} was done {done} times")
        return Result(
            database, dict(self.kills), len(self._evaluations), episodes, dict(outcomes), lost, self.faults, seconds
        )

    def _keep_busy(self) -> None:
        """Of each kind an evaluation is under way, and two workers wait for episodes."""
        going = [one for one in self._evaluations if not self._service.evaluation(one).status.finished]
        for kind, info in self._infos.items():
            if not any(self._evaluations[one] is kind for one in going):
                evaluation = self._service.submit(info, short(MISSIONS), kind=kind)
                self._evaluations[evaluation] = kind
        self._workers = [one for one in self._workers if one.poll() is None]
        while len(self._workers) < 2:
            arguments = [str(self._service.port), self._service.token, AgentKind.REMOTE.value]
            self._workers.append(
                subprocess.Popen([sys.executable, "-m", "tests.performance.kills", "--worker", *arguments], cwd=ROOT)
            )

    def _kill(self, target: str) -> None:
        if target == "server":
            self._service.kill()
            self._compare()
            self._service.start()
        elif target == "worker":
            worker = self._random.choice(self._workers)
            worker.kill()
            worker.wait()
        else:
            processes = self._service.episode_processes()
            if not processes:
                return
            os.kill(self._random.choice(processes), signal.SIGKILL)
        self.kills[target] += 1

    def _compare(self) -> None:
        """What was finished before must be as it was."""
        for evaluation in self._evaluations:
            for episode in self._service.episodes(evaluation):
                now = (episode.record_hash, episode.finished)
                if self._finished.get(episode.id, now) != now:
                    self.faults.append(f"{episode.id} was finished, and has changed")
                if episode.status is EpisodeStatus.DONE:
                    self._finished[episode.id] = now

    def _ended(self) -> bool:
        self._workers = [one for one in self._workers if one.poll() is None]
        return all(self._service.evaluation(one).status.finished for one in self._evaluations)


def _info(name: str) -> AgentInfo:
    return info_of(AGENT).model_copy(update={"name": name})


def _undisturbed(info: AgentInfo) -> list[str | None]:
    """Hashes of the records of an evaluation to which nothing happens."""
    benchmark = short(MISSIONS)
    source = (benchmark.name, benchmark.sha256)
    return [
        run_episode(one, {"ego": make_agent(AGENT)}, infos={"ego": info}, benchmark=source).record_hash
        for one in benchmark.scenarios([0])
    ]


def work(port: int, token: str, agent: str) -> None:
    """Drives episodes until it is killed; where the server is gone, or an episode, it begins again."""
    while True:
        try:
            worker = WireWorker(port, token, agent)
            while True:
                worker.drive(worker.acquire(END_S))
        except (OSError, HTTPException, AssertionError):
            time.sleep(0.2)


def campaign(database: str, kills: int, seed: int) -> Result:
    """One campaign on a database of this kind."""
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        options: dict[str, Any] = {"processes": 2, "lease_ttl_s": 2.0, "process_deaths": kills}
        if database == "postgresql":
            options["database"] = postgresql_with_tables(stack.enter_context(postgres.running()))
        service = Service(folder, **options)
        stack.callback(service.close)
        begun = time.monotonic()
        run = Campaign(service, seed)
        run.run(kills)
        return run.result(database, time.monotonic() - begun)


def main() -> int:
    """Prints the campaigns; the exit code is 1 where one has a fault."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kills", type=int, default=100)
    parser.add_argument("--database", nargs="+", default=["sqlite", "postgresql"], choices=["sqlite", "postgresql"])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--worker", nargs=3, metavar=("PORT", "TOKEN", "AGENT"), help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.worker:
        port, token, agent = options.worker
        work(int(port), token, agent)
    results = [asdict(campaign(database, options.kills, options.seed)) for database in options.database]
    for result in results:
        for name, value in result.items():
            print(f"{name:16} {value}")
        print()
    if options.json:
        options.json.write_text(json.dumps(results, indent=1) + "\n")
    return int(any(result["faults"] for result in results))


if __name__ == "__main__":
    sys.exit(main())
