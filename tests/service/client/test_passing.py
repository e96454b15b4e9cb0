"""What passes by itself, such as a restart of the service behind a proxy, ends neither workers nor episodes."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import msgspec
import pytest
import typer

from dohyo.evaluation.agent import Agent
from dohyo.service.cli.commands import worker as command
from dohyo.service.client import worker, worker_session
from dohyo.service.client.worker import Driver, keep_working, shares, work
from dohyo.service.client.worker_session import Drive, LeaseLostError, WireError, WorkerSession
from tests.service.client.scripted import BROKEN, Answer, Script, serving
from tests.service.served import ROOT, STEADY

REGISTERED = Answer({"worker": "w-1", "token": "t", "lease_ttl_s": 30.0}, 201)
GRANTED = Answer(
    {
        "lease": "l-1",
        "attempt": 1,
        "deadline_ms": 1000,
        "first_deadline_ms": 60000,
        "slow_policy": "wait",
        "spec": {"name": "mine", "sensors": ["speedometer"], "control": "lane_command"},
        "missions": [],
        "seed": 0,
        "tick": 0,
        "observations": {},
    }
)
DONE = Answer({"tick": 1, "time_s": 0.1, "observations": {}, "done": True, "missed": 0, "directive": "run"})
GONE = Answer({"detail": "lease lost: given back"}, 410)
AWAY = [Answer({}, status) for status in (500, 502, 503, 504)]


@pytest.fixture(autouse=True)
def _soon(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(worker_session.Pauses, "next", lambda pauses, error=None: 0.01)


@pytest.fixture
def script() -> Iterator[Script]:
    with serving() as script:
        yield script


def session_of(script: Script, patience_s: float = 60.0) -> WorkerSession:
    return WorkerSession(script.url, "token", "mine", patience_s=patience_s)


def driving(script: Script, patience_s: float = 60.0) -> tuple[WorkerSession, Drive]:
    script.answers += [REGISTERED, GRANTED]
    session = session_of(script, patience_s)
    drive = session.acquire()
    assert drive is not None
    return session, drive


def test_a_worker_outlives_what_a_proxy_answers_during_a_restart(script: Script) -> None:
    full = Answer({"detail": "expected at most 1 episodes at once"}, 409)
    script.answers += [*AWAY, REGISTERED, *AWAY, full, GRANTED, *AWAY, BROKEN, DONE]
    work(session_of(script), Driver(STEADY), episodes=1)


def test_a_refusal_for_good_ends_a_worker(script: Script) -> None:
    script.answers += [Answer({"detail": "no agent named 'mine' of yours"}, 404)]
    with pytest.raises(WireError, match="no agent named"):
        work(session_of(script), Driver(STEADY), episodes=1)


def test_a_release_is_repeated_until_it_is_answered(script: Script) -> None:
    session, drive = driving(script)
    script.answers += [*AWAY, BROKEN, Answer({}, 200)]
    session.release(drive, "the agent failed", "it raised an error")
    assert len({*script.bodies[2:]}) == 1
    assert msgspec.msgpack.decode(script.bodies[-1]) == {"reason": "the agent failed", "error": "it raised an error"}


def test_a_release_whose_answer_was_lost_has_happened(script: Script) -> None:
    session, drive = driving(script)
    script.answers += [BROKEN, GONE]
    session.release(drive)
    script.answers += [GONE]
    with pytest.raises(LeaseLostError):
        session.release(drive)


def test_the_patience_of_a_release_ends(script: Script) -> None:
    session, drive = driving(script)
    script.answers += [AWAY[1]]
    with pytest.raises(WireError, match="502"):
        session.release(drive, patience_s=0.0)


class StoppedWhileItBuilds(Driver):
    """Agents that are being built when the stop signal comes."""

    def agents(self, drive: Drive) -> dict[str, Agent]:
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(60)
        raise AssertionError


def test_a_stop_while_agents_are_built_gives_the_episode_back(script: Script) -> None:
    script.answers += [REGISTERED, GRANTED, Answer({}, 200)]
    work(session_of(script), StoppedWhileItBuilds(STEADY))
    assert script.asked[-1][0] == "POST /v1/leases/l-1/release"
    assert msgspec.msgpack.decode(script.bodies[-1]) == {"reason": "the worker was told to stop", "error": None}


def test_a_process_that_does_not_end_is_killed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(worker, "END_S", 0.3)
    marker = tmp_path / "deaf"
    code = "import signal, sys, time; signal.signal(signal.SIGTERM, signal.SIG_IGN); open(sys.argv[1], 'w').write("
    code += "str(__import__('os').getpid())); time.sleep(600)"

    def stop() -> None:
        while not marker.exists() or not marker.read_text():
            time.sleep(0.01)
        os.kill(os.getpid(), signal.SIGTERM)

    threading.Thread(target=stop, daemon=True).start()
    keep_working(["-S", "-c", code, str(marker)], [None], {})
    with pytest.raises(ProcessLookupError):
        os.kill(int(marker.read_text()), 0)


@pytest.mark.parametrize(
    ("episodes", "processes", "shared"),
    [(10, 4, [3, 3, 2, 2]), (2, 4, [1, 1]), (5, 1, [5]), (4, 2, [2, 2]), (None, 2, [None, None])],
)
def test_episodes_are_shared_out(episodes: int | None, processes: int, shared: list[int | None]) -> None:
    assert shares(episodes, processes) == shared


def test_processes_of_a_worker_drive_the_episodes_together(monkeypatch: pytest.MonkeyPatch) -> None:
    started: list[Sequence[int | None]] = []

    def note(command: Sequence[str], episodes: Sequence[int | None], environment: Mapping[str, str]) -> None:
        assert "--episodes" not in command
        started.append(episodes)

    monkeypatch.setattr(command, "keep_working", note)
    monkeypatch.setattr(command, "_declare", lambda *_: 1)
    command.worker("http://127.0.0.1:9", "mine", "token", STEADY, capacity=4, episodes=10)
    command.worker("http://127.0.0.1:9", "mine", "token", STEADY, capacity=2)
    assert started == [[3, 3, 2, 2], [None, None]]


DRIVES_TWO_AND_DIES = """
import os, sys
log, *options = sys.argv[1:]
with open(log, "a") as told:
    print(*options, file=told)
if options != ["--episodes", "1"]:
    with open(os.environ["DOHYO_WORKER_TALLY"], "ab") as tally:
        tally.write(b"..")
    os.kill(os.getpid(), 9)
"""


@pytest.mark.parametrize(("share", "told"), [(3, ["--episodes 3", "--episodes 1"]), (2, ["--episodes 2"])])
def test_a_process_that_dies_is_started_again_for_the_rest_of_its_share(
    tmp_path: Path, share: int, told: list[str]
) -> None:
    log = tmp_path / "log"
    keep_working(["-S", "-c", DRIVES_TWO_AND_DIES, str(log)], [share], {})
    assert log.read_text().splitlines() == told


def test_a_process_counts_the_episodes_that_it_has_driven(
    script: Script, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tally = tmp_path / "tally"
    monkeypatch.setenv(worker.TALLY, str(tally))
    monkeypatch.setattr(command, "_declare", lambda *_: 1)
    script.answers += [REGISTERED, GRANTED, DONE, GRANTED, GONE, GRANTED, DONE]
    command.worker(script.url, "mine", "token", STEADY, episodes=3)
    assert tally.stat().st_size == 3


def test_a_process_that_starts_while_the_service_is_away_is_started_again(script: Script) -> None:
    script.answers += [AWAY[1]]
    with pytest.raises(typer.Exit) as ended:
        command.worker(script.url, "mine", "token", STEADY)
    assert ended.value.exit_code not in (0, worker.REFUSED)


def example(url: str) -> subprocess.Popen[str]:
    arguments = [sys.executable, "-S", "examples/worker_stdlib.py", url, "secret", "mine"]
    return subprocess.Popen(arguments, cwd=ROOT, stderr=subprocess.PIPE, text=True)


@pytest.mark.parametrize("url", ["ftp://127.0.0.1", "127.0.0.1:8000", "https://"])
def test_the_example_refuses_other_addresses_in_one_line(url: str) -> None:
    with example(url) as process:
        told = process.communicate(timeout=60)[1]
    assert process.returncode == 1
    assert told == f"expected the service's address, such as http://127.0.0.1:8000, got '{url}'\n"


def test_the_example_encrypts_its_token() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.settimeout(60)
        with example(f"https://127.0.0.1:{server.getsockname()[1]}") as process:
            connection, _ = server.accept()
            with connection:
                sent = connection.recv(4096)
            process.communicate(timeout=60)
    assert sent[:2] == b"\x16\x03"  # a TLS handshake
    assert b"secret" not in sent
