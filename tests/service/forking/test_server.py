"""A copy has what its request names and nothing else; it ends with its server, and its number stays its own."""

from __future__ import annotations

import json
import os
import signal
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from dohyo.service.forking import server
from dohyo.service.forking.process import ForkedProcess
from dohyo.service.forking.server import Launch, Template, fork
from tests.service.served import wait_until

TEMPLATE = Template("time:time")
COMMON = {"COMMON": "1"}


@pytest.fixture(autouse=True)
def _no_server_left() -> Iterator[None]:
    yield
    if (left := server._servers.pop(TEMPLATE, None)) is not None:
        left.end()


def start(name: str, folder: Path, **variables: str) -> tuple[ForkedProcess, int]:
    """A copy that calls a function of `copies`, and the pipe of its answer."""
    answer, theirs = os.pipe()
    launch = Launch(
        f"tests.service.forking.copies:{name}", "test-copy", variables, folder, [str(Path.cwd()), *sys.path]
    )
    try:
        return fork(TEMPLATE, COMMON, launch, (theirs,)), answer
    finally:
        os.close(theirs)


def test_a_copy_has_its_own_files_variables_and_session_only(tmp_path: Path) -> None:
    copy, answer = start("tell", tmp_path, OWN="2")
    other, _ = start("tell", tmp_path, OTHER="3")
    seen = json.loads(os.read(answer, 10_000))
    assert seen["variables"] == {"OWN": "2"}
    assert set(seen["files"]) == {0, 1, 2, seen["answer"]}
    assert (seen["folder"], seen["leader"]) == (str(tmp_path), True)
    assert (copy.wait(120), other.wait(120)) == (0, 0)


def test_the_number_of_an_ended_copy_is_kept_until_its_release(tmp_path: Path) -> None:
    copy, answer = start("stay", tmp_path)
    assert os.read(answer, 10) == b"here"
    copy.kill()
    assert copy.wait(120) == -signal.SIGKILL
    assert Path(f"/proc/{copy.pid}").exists()
    copy.release()
    wait_until(lambda: not Path(f"/proc/{copy.pid}").exists(), "the server keeps the process")


def test_all_that_wait_for_a_copy_see_its_end(tmp_path: Path) -> None:
    for _ in range(20):
        copy, answer = start("stay", tmp_path)
        assert os.read(answer, 10) == b"here"
        os.close(answer)
        with ThreadPoolExecutor(4) as threads:
            waiting = [threads.submit(copy.wait, 120.0) for _ in range(4)]
            assert copy.poll() is None
            os.kill(copy.pid, signal.SIGKILL)
            assert [one.result() for one in waiting] == [-signal.SIGKILL] * 4
        copy.release()


def test_copies_end_with_their_server_and_the_next_one_gets_another(tmp_path: Path) -> None:
    copy, answer = start("stay", tmp_path)
    assert os.read(answer, 10) == b"here"
    os.kill(server._servers[TEMPLATE]._process.pid, signal.SIGKILL)
    assert copy.wait(120) == -signal.SIGKILL
    assert os.read(answer, 10) == b""  # the copy's end of the pipe is closed, so it is gone
    again, answer = start("stay", tmp_path)
    assert os.read(answer, 10) == b"here"
    again.kill()
    again.wait(120)


def test_a_server_and_its_copies_ignore_sigterm_which_is_for_the_service(tmp_path: Path) -> None:
    copy, answer = start("stay", tmp_path)
    assert os.read(answer, 10) == b"here"
    before = server._servers[TEMPLATE]
    for pid in (copy.pid, before._process.pid):
        os.kill(pid, signal.SIGTERM)
    other, answer = start("stay", tmp_path)
    assert os.read(answer, 10) == b"here"
    assert server._servers[TEMPLATE] is before
    assert copy.poll() is None
    for one in (copy, other):
        one.kill()
        assert one.wait(120) == -signal.SIGKILL
