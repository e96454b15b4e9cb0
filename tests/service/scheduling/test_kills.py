"""kill -9 and SIGTERM at bad moments: nothing finished is lost, nothing is counted twice, every end is honest."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime
from functools import cache
from pathlib import Path

import httpx
import pytest

from dohyo.evaluation.agent import make_agent
from dohyo.evaluation.episode.runner import drive_episode, run_episode
from dohyo.evaluation.records.record import AgentInfo
from dohyo.evaluation.records.specifications import Status
from dohyo.evaluation.records.store import write_record
from dohyo.service.episodes.archive import archived_path, staged_folder
from dohyo.service.evaluations.model import EpisodeStatus, Evaluation, EvaluationStatus
from dohyo.service.networks.model import UploadedNetwork
from dohyo.service.scheduling import attempts
from dohyo.service.storage.usage import LARGE_RECORD
from dohyo.service.submissions.model import AgentKind
from tests.service.conftest import MakeService
from tests.service.served import ROOT, STEADY, Service, info_of, short, wait_until
from tests.service.workers.wire_worker import WireWorker, hire

AGENTS = "tests.evaluation.agents"
Undisturbed = Callable[..., list[str | None]]
SEEDS = (0, 1, 2)  # drives enough that a slow test comes before the last one
pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    """A running service for whatever does not kill it; it soon takes a worker for dead.

    Its owners may keep so little that their bytes are summed before each episode.
    """
    settings = {"processes": 1, "lease_ttl_s": 8.0, "process_deaths": 3, "bytes_per_owner": LARGE_RECORD - 1}
    shared = Service(tmp_path_factory.mktemp("data"), **settings)
    shared.start()
    yield shared
    shared.close()


@pytest.fixture(scope="module")
def undisturbed() -> Undisturbed:
    """Hashes of the records of an evaluation to which nothing happens, driven here, by number of missions and agent."""

    @cache
    def hashes(missions: int, name: str = "steady", seeds: tuple[int, ...] = (0,)) -> list[str | None]:
        benchmark = short(missions)
        source = (benchmark.name, benchmark.sha256)
        infos = {"ego": steady(name)}
        return [
            run_episode(one, {"ego": make_agent(STEADY)}, infos=infos, benchmark=source).record_hash
            for one in benchmark.scenarios(seeds)
        ]

    return hashes


def steady(name: str) -> AgentInfo:
    return info_of(STEADY).model_copy(update={"name": name})


def spawn_worker(service: Service, pause_s: float = 60.0) -> subprocess.Popen[str]:
    """A worker in a process of its own that stops after ten steps; it has driven those when this returns."""
    arguments = [str(service.port), service.token, "steady", str(pause_s)]
    process = subprocess.Popen(
        [sys.executable, "-m", "tests.service.workers.wire_worker", *arguments],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "driving\n"
    return process


def test_kill_nine_of_a_worker_lets_another_drive_the_episode_again(service: Service, undisturbed: Undisturbed) -> None:
    evaluation = service.submit(info_of(STEADY), short())
    killed = spawn_worker(service)
    killed.kill()
    killed.wait()
    worker = hire(service)
    episode = worker.acquire()
    assert (episode["attempt"], episode["tick"]) == (2, 0)
    worker.drive(episode)
    assert service.hashes(evaluation) == undisturbed(1)
    assert service.episodes(evaluation)[0].attempts == 2


def test_workers_that_leave_twice_lose_the_episode_and_cannot_erase_it(service: Service) -> None:
    """Review: `release` without an error and `resume` gave a ranked drive as many tries as its owner wanted."""
    evaluation = service.submit(info_of(STEADY), short(missions=2))
    worker = hire(service)
    worker.drive(worker.acquire())
    leaving = hire(service)
    first = leaving.acquire()
    leaving.drive(first, steps=3)
    assert leaving.post(f"/v1/leases/{first['lease']}/release", {"reason": "a bad draw"})[0] == 204
    wait_until(lambda: "given_back" in [one.outcome for one in service.attempts(evaluation)], "it is not given back")
    owner = {"Authorization": f"Bearer {service.submitter_token}"}
    for wish in ("cancel", "resume"):
        httpx.post(f"{service.url}/v1/evaluations/{evaluation}/{wish}", headers=owner, timeout=120).raise_for_status()
    assert hire(service).acquire()["attempt"] >= 1  # and not a word more
    hashes = service.hashes(evaluation)
    assert None not in hashes
    (failed,) = [one for position in (0, 1) if (one := service.record(evaluation, position).egos[0]).status.agent_fault]
    assert failed.status is Status.AGENT_DEADLINE
    assert "submission has no attempt left; the last: the worker was not heard of" in (failed.failure or "")
    charged = [(one.outcome, one.why) for one in service.attempts(evaluation) if one.charged]
    assert [outcome for outcome, _ in charged] == ["given_back", "worker_gone"]
    assert "a bad draw" in (charged[0][1] or "")


def test_a_drive_that_its_owner_cancels_counts_as_an_attempt(service: Service) -> None:
    evaluation = service.submit(info_of(STEADY), short())
    owner = {"Authorization": f"Bearer {service.submitter_token}"}
    for attempt in (1, 2):
        worker = hire(service)
        episode = worker.acquire()
        assert episode["attempt"] == attempt
        worker.drive(episode, steps=2)
        for wish in ("cancel", "resume"):
            path = f"{service.url}/v1/evaluations/{evaluation}/{wish}"
            httpx.post(path, headers=owner, timeout=120).raise_for_status()
    worker.post(f"/v1/workers/{worker.worker}/acquire?wait=2")  # a worker waits, so that the episode is taken
    (ego,) = service.record(evaluation).egos
    assert (ego.status, ego.progress_m) == (Status.AGENT_DEADLINE, 0.0)


def test_a_drive_that_ends_since_its_owner_fills_the_disk_counts_as_an_attempt(service: Service) -> None:
    info = info_of(STEADY).model_copy(update={"name": "filler"})  # no worker of another test waits for it
    evaluation = service.submit(info, short(missions=2))
    worker = hire(service, "filler")
    worker.drive(worker.acquire(), steps=2)
    with service.database.session() as session:
        owner = session.get_one(Evaluation, evaluation).owner
        session.add(UploadedNetwork(name="ballast", owner=owner, kept_bytes=10**15))
    other = hire(service, "filler")
    other.post(f"/v1/workers/{other.worker}/acquire?wait=2")
    assert service.wait(evaluation).status is EvaluationStatus.FAILED
    with service.database.session() as session:
        session.delete(session.get_one(UploadedNetwork, "ballast"))
    assert [one.outcome for one in service.attempts(evaluation) if one.charged] == ["cancelled"]


def test_kill_nine_of_an_episode_process_costs_its_worker_the_lease_and_the_drive_is_repeated(
    service: Service, undisturbed: Undisturbed
) -> None:
    """Also the second time, which is the last but one."""
    evaluation = service.submit(info_of(STEADY), short())
    worker = hire(service)
    for attempt in (1, 2):
        episode = worker.acquire()
        assert episode["attempt"] == attempt
        reply = worker.drive(episode, steps=2)
        for process in service.episode_processes():
            os.kill(process, signal.SIGKILL)
        status, problem = worker.step(episode["lease"], reply["tick"], {"ego": [6.0, 0.0]})
        assert (status, "-9" in problem["detail"]) == (410, True), problem
    worker.drive(worker.acquire())
    assert service.hashes(evaluation) == undisturbed(1)
    attempts = service.attempts(evaluation)
    assert [one.outcome for one in attempts if one.outcome != "unclaimed"] == ["machine"] * 2 + ["done"]
    assert not any(one.charged for one in attempts)
    assert all(one.processor_s > 0.0 for one in attempts if one.outcome == "done")


def test_a_built_in_agent_whose_process_always_dies_is_lost_in_the_end(service: Service, tmp_path: Path) -> None:
    once = info_of(f"{AGENTS}:DiesOnce", marker=str(tmp_path / "marker")).model_copy(update={"name": "once"})
    always = info_of(f"{AGENTS}:DiesAlways").model_copy(update={"name": "always"})
    survives = service.submit(once, short(), kind=AgentKind.BUILTIN)
    dies = service.submit(always, short(), kind=AgentKind.BUILTIN)
    assert service.record(survives).egos[0].status.completed
    assert service.episodes(survives)[0].attempts == 2
    ended = service.wait(dies)
    assert (ended.status, "code -9" in (ended.failure or "")) == (EvaluationStatus.FAILED, True)


def test_a_built_in_agent_that_never_returns_is_at_fault(service: Service) -> None:
    hangs = info_of(f"{AGENTS}:HangsOutsidePython", after=2)
    evaluation = service.submit(hangs, short(), kind=AgentKind.BUILTIN, act_deadline_s=0.3)
    (ego,) = service.record(evaluation).egos
    assert ego.status is Status.AGENT_DEADLINE
    assert service.episodes(evaluation)[0].attempts == 1


def test_code_that_changed_since_it_was_submitted_is_not_driven(service: Service) -> None:
    old = info_of(STEADY).model_copy(update={"source_sha256": "0" * 64})
    ended = service.wait(service.submit(old, short(), kind=AgentKind.BUILTIN))
    assert (ended.status, "has changed" in (ended.failure or "")) == (EvaluationStatus.FAILED, True)


@dataclass
class Revived:
    """A service that was ended by kill -9 and started again.

    Attributes:
        service: Runs again.
        builtin: Evaluation of a built-in agent, which was under way.
        kept: Its records at the kill, and when each was finished, by position.
        orphans: Processes of episodes at the kill.
        remote: Evaluation whose worker had begun.
        worker: That worker.
        staged: Evaluation whose record was written, and not yet known to the database.
        inode: Of that record.
    """

    service: Service
    builtin: str
    kept: dict[int, tuple[str | None, datetime | None]]
    orphans: list[int]
    remote: str
    worker: WireWorker
    staged: str
    inode: int


@pytest.fixture(scope="module")
def revived(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Revived]:
    service = Service(tmp_path_factory.mktemp("killed"), processes=1)
    try:
        builtin = service.submit(steady("builtin"), short(missions=4), kind=AgentKind.BUILTIN, seeds=SEEDS)
        remote = service.submit(steady("remote"), short())
        service.start()
        worker = hire(service, "remote")
        worker.drive(worker.acquire(), steps=5)
        service.wait_done(builtin, 1)
        orphans = service.episode_processes()
        service.kill()
        kept = finished(service, builtin)
        staged, inode = leave_in_staging(service)
        wait_until(lambda: not any(map(lives, orphans)), "episode processes outlive the server")
        service.start()
        yield Revived(service, builtin, kept, orphans, remote, worker, staged, inode)
    finally:
        service.close()


def lives(process: int) -> bool:
    return Path(f"/proc/{process}").exists()


def finished(service: Service, evaluation: str) -> dict[int, tuple[str | None, datetime | None]]:
    episodes = service.episodes(evaluation)
    return {one.position: (one.record_hash, one.finished) for one in episodes if one.record_hash}


def leave_in_staging(service: Service) -> tuple[str, int]:
    """As if the server had died between a record and the database's commit: the evaluation, the record's inode."""
    info, benchmark = steady("staged"), short()
    evaluation = service.submit(info, benchmark, kind=AgentKind.BUILTIN)
    folder = staged_folder(service.settings, evaluation)
    folder.mkdir(parents=True)
    (episode,) = service.episodes(evaluation)
    source = (benchmark.name, benchmark.sha256)
    (scenario,) = benchmark.scenarios([0])
    record, trajectory = drive_episode(scenario, {"ego": make_agent(STEADY)}, infos={"ego": info}, benchmark=source)
    write_record(folder, episode.id, record, trajectory)
    with service.database.session() as session:
        there = session.merge(episode)
        there.status, there.attempts = EpisodeStatus.RUNNING, 1
        attempts.begin(session, there)
        session.merge(service.evaluation(evaluation)).status = EvaluationStatus.RUNNING
    return evaluation, (folder / f"{episode.id}.json").stat().st_ino


def test_kill_nine_of_the_server_loses_nothing_and_counts_nothing_twice(
    revived: Revived, undisturbed: Undisturbed
) -> None:
    service = revived.service
    assert 0 < len(revived.kept) < 4 * len(SEEDS), "it finished before the kill; the test shows nothing"
    hashes = service.hashes(revived.builtin)
    after = finished(service, revived.builtin)
    assert {position: after[position] for position in revived.kept} == revived.kept
    assert all(one.attempts == 1 for one in service.episodes(revived.builtin))
    assert not staged_folder(service.settings, revived.builtin).exists()
    assert hashes == undisturbed(4, "builtin", SEEDS)


def test_a_record_that_a_dead_server_left_in_staging_is_kept_and_not_driven_again(revived: Revived) -> None:
    service = revived.service
    (record_hash,) = service.hashes(revived.staged)
    assert record_hash is not None
    assert archived_path(service.settings, record_hash).stat().st_ino == revived.inode
    assert service.episodes(revived.staged)[0].attempts == 1


def test_a_remote_worker_survives_kill_nine_of_the_server(revived: Revived, undisturbed: Undisturbed) -> None:
    service = revived.service
    again = hire(service, "remote")
    assert again.post(f"/v1/workers/{revived.worker.worker}/acquire?wait=0")[0] == 404
    episode = again.acquire()
    assert (episode["attempt"], episode["tick"]) == (1, 0)
    again.drive(episode)
    assert service.hashes(revived.remote) == undisturbed(1, "remote")


def family(pid: int) -> list[int]:
    """A process and all that it has started, and they in turn."""
    parents = {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            parents[int(stat.parent.name)] = int(stat.read_text().rpartition(")")[2].split()[1])
    return [pid, *(one for child, parent in parents.items() if parent == pid for one in family(child))]


@pytest.mark.parametrize("receivers", ["service", "all processes"])  # systemd's default is the latter
def test_sigterm_under_load_lets_episodes_end_and_leaves_nothing_running(
    make_service: MakeService, receivers: str
) -> None:
    service = make_service(processes=1, drain_s=120.0)
    queued = [
        service.submit(steady(f"queued-{i}"), short(missions=4), kind=AgentKind.BUILTIN, seeds=SEEDS[:2])
        for i in range(2)
    ]
    remote = service.submit(steady("remote"), short())
    service.start()
    worker = hire(service, "remote")
    episode = worker.acquire()
    reply = worker.drive(episode, steps=5)
    service.wait_done(queued[0], 1)
    assert service.process is not None
    assert service.process.pid is not None
    pids = family(service.process.pid)
    assert len(pids) >= 3  # a fork server and its copy
    for pid in pids if receivers == "all processes" else pids[:1]:
        os.kill(pid, signal.SIGTERM)
    directives = set()
    while not reply.get("done"):
        _, reply = worker.step(episode["lease"], reply["tick"], {"ego": [6.0, 0.0]})
        directives.add(reply["directive"])
    assert "drain" in directives
    status, _ = worker.post(f"/v1/workers/{worker.worker}/acquire?wait=5")
    assert status == 503
    assert service.process.wait(120) == 0
    assert service.evaluation(remote).status is EvaluationStatus.DONE
    statuses = [one.status for evaluation in queued for one in service.episodes(evaluation)]
    assert EpisodeStatus.RUNNING not in statuses
    assert EpisodeStatus.QUEUED in statuses, "it had nothing left to do; the test shows nothing"
    service.start()
    for evaluation in queued:
        assert len(set(service.hashes(evaluation))) == 8
        assert all(one.attempts == 1 for one in service.episodes(evaluation))
