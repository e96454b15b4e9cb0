"""What passes by itself, such as a restart of the service behind a proxy, ends neither workers nor episodes."""

from __future__ import annotations

import os
import runpy
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec
import pytest
import typer

from dohyo.evaluation.agent import Agent
from dohyo.service.cli.commands import worker as command
from dohyo.service.client import worker
from dohyo.service.client.connection import BadActionError, LeaseLostError, Pauses, WireError
from dohyo.service.client.worker import Driver, keep_working, shares, work
from dohyo.service.client.worker_session import Drive, WorkerSession
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
ABORTED = Answer({"tick": 1, "time_s": 0.1, "observations": {}, "done": True, "missed": 0, "directive": "abort"})
AWAY = [Answer({}, status) for status in (500, 502, 503, 504)]


@pytest.fixture(autouse=True)
def _soon(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Pauses, "next", lambda pauses, error=None: 0.01)


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


PLANS = {"planner": {"speeds": [[20.0, 30.0], [25.0, 30.0]]}}
FORECASTS = {"forecaster": {"history": [[20.0 + minute, 30.0] for minute in range(8)]}}


@pytest.mark.parametrize(
    ("name", "observations", "shape", "told"),
    [("planner", PLANS, [2, 2], "0.00 h\n" * 4), ("forecaster", FORECASTS, [3, 2], "a day until 0.00 h\n" * 2)],
)
def test_an_example_outlives_a_restart_and_counts_what_is_done(
    name: str,
    observations: dict[str, Any],
    shape: list[int],
    told: str,
    script: Script,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    granted = Answer(GRANTED.body | {"observations": observations})  # type: ignore[operator]
    under_way = Answer(DONE.body | {"observations": observations, "done": False})  # type: ignore[operator]
    unknown = Answer({"detail": "unknown token"}, 401)
    script.answers += [REGISTERED, BROKEN, AWAY[2], unknown, REGISTERED, Answer("", 204)]
    script.answers += [granted, ABORTED, granted, GONE, granted, under_way, BROKEN, unknown, REGISTERED]
    script.answers += [granted, DONE, granted, DONE]
    monkeypatch.setattr(sys, "argv", [f"{name}.py", script.url, "secret", "mine", "2"])
    runpy.run_path(str(ROOT / "examples" / f"{name}.py"), run_name="__main__")
    said = capsys.readouterr().out
    assert [line for line in said.splitlines(keepends=True) if "HTTP" not in line] == told.splitlines(keepends=True)
    steps = [body for (request, _), body in zip(script.asked, script.bodies, strict=True) if "/step" in request]
    assert msgspec.msgpack.decode(steps[0])["actions"][name]["shape"] == shape


def test_an_example_whose_decision_is_refused_ends(script: Script, monkeypatch: pytest.MonkeyPatch) -> None:
    refused = Answer({"detail": "expected target speeds of 0 to 45 m/s"}, 422)
    script.answers += [REGISTERED, Answer(GRANTED.body | {"observations": PLANS}), refused]  # type: ignore[operator]
    monkeypatch.setattr(sys, "argv", ["planner.py", script.url, "secret", "mine"])
    with pytest.raises(BadActionError, match="expected target speeds"):
        runpy.run_path(str(ROOT / "examples" / "planner.py"), run_name="__main__")


def example(url: str) -> subprocess.Popen[str]:
    arguments = [sys.executable, "-S", "examples/worker_stdlib.py", url, "secret", "mine"]
    return subprocess.Popen(arguments, cwd=ROOT, stderr=subprocess.PIPE, text=True)


NODE = shutil.which("node")
PLAIN = [
    pytest.param([sys.executable, "-S", "examples/worker_stdlib.py"], id="python"),
    pytest.param(
        [NODE or "node", "examples/worker.mjs"], id="node", marks=pytest.mark.skipif(not NODE, reason="no node")
    ),
]


@pytest.mark.parametrize("command", PLAIN)
@pytest.mark.parametrize("last", [BROKEN, Answer({"detail": "the service is about to end"}, 503)])
def test_a_plain_example_ends_with_one_line_when_the_service_does(
    command: list[str], last: Answer, script: Script
) -> None:
    script.answers += [REGISTERED, last]
    done = subprocess.run(
        [*command, script.url, "secret", "mine"], cwd=ROOT, capture_output=True, text=True, timeout=60
    )
    assert done.returncode == 1
    (line,) = done.stderr.splitlines()
    assert line.startswith(f"no answer from {script.url}: " if last is BROKEN else "503: ")


@pytest.mark.parametrize("command", PLAIN)
def test_a_plain_example_without_arguments_says_how_it_is_called(command: list[str]) -> None:
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout) == (1, "")
    assert len(done.stderr.strip().splitlines()) == 1
    assert "http://127.0.0.1:8000 TOKEN AGENT" in done.stderr


@pytest.mark.parametrize("command", PLAIN)
def test_a_plain_example_keeps_the_path_of_its_address(command: list[str], script: Script) -> None:
    script.answers += [REGISTERED, Answer({}, 503)]
    subprocess.run([*command, f"{script.url}/dohyo/", "secret", "mine"], cwd=ROOT, capture_output=True, timeout=60)
    assert [asked for asked, _ in script.asked] == [
        "POST /dohyo/v1/workers",
        "POST /dohyo/v1/workers/w-1/acquire?wait=20",
    ]


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
