from __future__ import annotations

import multiprocessing
import os
from collections.abc import Mapping
from multiprocessing.connection import Connection
from pathlib import Path

import pytest

from dohyo.sumo_networks import processes
from dohyo.sumo_networks.processes import usable_processors, worker_context, worker_pool, worker_process


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


@pytest.mark.parametrize(
    ("affinity", "own", "limits", "usable"),
    [
        (8, "0::/", {}, 8),
        (1, "0::/", {}, 1),
        (8, "0::/", {"cpu.max": "200000 100000"}, 2),
        (8, "0::/", {"cpu.max": "150000 100000"}, 2),
        (8, "0::/", {"cpu.max": "20000 100000"}, 1),
        (2, "0::/", {"cpu.max": "400000 100000"}, 2),
        (8, "0::/", {"cpu.max": "max 100000"}, 8),
        (8, "0::/", {"cpu.max": "nonsense"}, 8),
        (
            8,
            "0::/a.slice/b.service",
            {"a.slice/b.service/cpu.max": "max 100000", "a.slice/cpu.max": "300000 100000"},
            3,
        ),
        (8, "0::/a.slice/b.service", {"a.slice/b.service/cpu.max": "100000 50000", "a.slice/cpu.max": "max 100000"}, 2),
        (8, "4:cpu:/a", {"cpu.max": "100000 100000"}, 8),
        (8, None, {}, 8),
    ],
)
def test_processors_are_those_of_the_affinity_and_of_the_quota(
    affinity: int,
    own: str | None,
    limits: Mapping[str, str],
    usable: int,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda pid: set(range(affinity)))
    monkeypatch.setattr(processes, "CGROUPS", tmp_path)
    monkeypatch.setattr(processes, "OWN_CGROUP", tmp_path / "cgroup")
    if own is not None:
        (tmp_path / "cgroup").write_text(f"9:name=systemd:/\n{own}\n")
    for name, text in limits.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(f"{text}\n")
    assert usable_processors() == usable
