from __future__ import annotations

import multiprocessing
import os
from multiprocessing.connection import Connection

import pytest

from dohyo.sumo_networks.processes import worker_context, worker_pool, worker_process


def tell(pipe: Connection, name: str) -> None:
    pipe.send((os.getpid(), os.environ.get(name)))


def told(name: str) -> tuple[int, str | None]:
    ours, theirs = worker_context().Pipe()
    process = worker_process(tell, theirs, name)
    process.start()
    theirs.close()
    process.join()
    answer: tuple[int, str | None] = ours.recv()
    return answer


def read(name: str) -> str | None:
    return os.environ.get(name)


def test_a_process_has_the_environment_of_its_parent_at_its_start(monkeypatch: pytest.MonkeyPatch) -> None:
    seen = []
    for value in ("one", "two"):
        monkeypatch.setenv("DOHYO_TEST", value)
        seen.append(told("DOHYO_TEST"))
    monkeypatch.delenv("DOHYO_TEST")
    seen.append(told("DOHYO_TEST"))
    assert [value for _, value in seen] == ["one", "two", None]
    assert len({os.getpid(), *(pid for pid, _ in seen)}) == 4


def test_a_pool_has_it_too(monkeypatch: pytest.MonkeyPatch) -> None:
    for value in ("one", "two"):
        monkeypatch.setenv("DOHYO_TEST", value)
        with worker_pool(1, read) as pool:
            assert pool.submit(read, "DOHYO_TEST").result() == value


def tell_from_a_child(pipe: Connection) -> None:
    pipe.send(told("PATH"))


def test_a_process_that_was_forked_has_workers_of_its_own() -> None:
    """Libraries fork: the server of the parent cannot be used there."""
    told("PATH")
    fork = multiprocessing.get_context("fork")
    ours, theirs = fork.Pipe()
    child = fork.Process(target=tell_from_a_child, args=(theirs,))
    child.start()
    theirs.close()
    pid, path = ours.recv()
    child.join()
    assert pid not in (os.getpid(), child.pid)
    assert path == os.environ["PATH"]
