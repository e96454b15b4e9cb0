"""The runner against hostile input: one clear error, a line in the log, no process and no folder left."""

from __future__ import annotations

import asyncio
import json
import logging
import os
import tempfile
from collections.abc import Iterator
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import pytest

from dohyo.service.confinement import folders, runner
from dohyo.service.confinement.environment import OF_TASKS
from dohyo.service.confinement.limits import Limits
from dohyo.service.confinement.process import ENVIRONMENT
from dohyo.service.confinement.runner import run, run_async
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.networks.conversion.source_file import ImportOptions
from tests.service.served import wait_until

LIMITS = Limits(wall_s=120.0, cpu_s=60, memory_mb=1500, file_mb=20, folder_mb=60)
HERE = Path(__file__).parent
HOSTILE = "tests.service.confinement.hostile"


@pytest.fixture
def groups(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Process groups that the runner has started."""
    found: list[int] = []
    watch = runner._watch

    def noted(group: int, *rest: Any) -> Any:
        found.append(group)
        return watch(group, *rest)

    monkeypatch.setattr(runner, "_watch", noted)
    return found


@pytest.fixture(autouse=True)
def nothing_is_left(groups: list[int]) -> Iterator[None]:
    """After each test no confined process and no private folder of this process exists."""
    yield
    wait_until(lambda: not any(map(processes_of, groups)), "a confined process lives on")
    assert left_folders() == []


def left_folders() -> list[Path]:
    return list(Path(tempfile.gettempdir()).glob(f"{folders.PREFIX}{os.getpid()}-*"))


def processes_of(group: int) -> int:
    return runner._use(group)[0]


def attack(name: str, limits: Limits = LIMITS, **settings: Any) -> Any:
    """Builds a hostile agent as the trial of a submission does."""
    arguments = {"entry": f"{HOSTILE}:{name}", "settings": settings}
    return run("describe_agent", arguments, limits, reads=[HERE])


def test_a_task_has_no_variable_of_the_service(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DOHYO_DATABASE", "postgresql://dohyo:secret@localhost/dohyo")
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "secret")
    with pytest.raises(InvalidInputError) as caught:
        attack("Environment")
    told = str(caught.value)
    seen = json.loads(told[told.index("{") :])
    assert "secret" not in told
    same = {name for name, value in seen.items() if os.environ.get(name) == value}
    set_by_libraries = ("SUMO", "PROJ", "SDL", "PYGAME", "_RJEM")
    libraries = {name for name in same if name.startswith(set_by_libraries)}
    assert same - libraries <= {*ENVIRONMENT, *OF_TASKS, "DOHYO_CACHE", "XDG_CACHE_HOME"}


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("Memory", "MemoryError|more memory than it may have"),
        ("SharedMemory", "more than the 1500 MB of memory"),
        ("Loop", "used more than 1 s of processor time"),
        ("Sleep", "took longer than 1 s"),
        ("Fork", "not permitted"),
        ("Program", "not permitted"),
        ("Threads", "took longer than 1 s"),
        ("Network", "not permitted"),
        ("Leaver", "not permitted"),
        ("LargeFile", "larger file than it may"),
        ("ManyFiles", "more than the 60 MB of files"),
    ],
)
def test_an_attack_is_one_error_that_the_log_names(
    name: str, says: str, groups: list[int], caplog: pytest.LogCaptureFixture
) -> None:
    limits = replace(LIMITS, wall_s=1.0 if "took longer" in says else 120.0, cpu_s=1 if name == "Loop" else 60)
    with pytest.raises(InvalidInputError, match=f"(?i){says}"):
        attack(name, limits)
    assert len(groups) == 1
    logged = [one for one in caplog.records if one.name == "dohyo.confinement" and one.levelno == logging.WARNING]
    assert [one.getMessage() for one in logged if "task 'describe_agent'" in one.getMessage()], caplog.text


def test_a_task_neither_reads_nor_writes_what_it_is_not_given(tmp_path: Path) -> None:
    secret = tmp_path / "dohyo.db"
    secret.write_text("hashes of tokens")
    paths = (
        secret,
        tmp_path / "new",
        f"/proc/{os.getpid()}/environ",
        "/etc/passwd",
        HERE / "new",
        runner.__file__ + "x",
    )
    with pytest.raises(InvalidInputError, match=r"opened: \[\]"):
        attack("Paths", paths=[str(path) for path in paths])
    assert secret.read_text() == "hashes of tokens"
    assert list(tmp_path.iterdir()) == [secret]


def test_an_answer_without_end_is_cut() -> None:
    with pytest.raises(InvalidInputError) as caught:
        attack("Flood")
    assert len(str(caught.value)) < 10_000


def test_no_more_programs_than_allowed(tmp_path: Path, groups: list[int]) -> None:
    town = tmp_path / "town.osm"
    nodes = "".join(f'<node id="{i}" lat="52.{i:06d}" lon="13.4"/>' for i in range(60_000))
    town.write_text(f'<osm version="0.6">{nodes}</osm>')
    arguments = {"file": str(town), "name": "town", "options": asdict(ImportOptions(limit_mb=100.0))}
    with pytest.raises(InvalidInputError, match="it started 2 processes, at most 1 are allowed"):
        run("import_roads", arguments, replace(LIMITS, processes=1), reads=[town])


def test_a_cancelled_task_is_ended(groups: list[int]) -> None:
    async def cancelled() -> None:
        arguments = {"entry": f"{HOSTILE}:Sleep", "settings": {}}
        task = asyncio.create_task(run_async("describe_agent", arguments, LIMITS, reads=[HERE]))
        await asyncio.to_thread(wait_until, lambda: bool(groups), "the task does not start")
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task

    asyncio.run(cancelled())
    wait_until(lambda: not processes_of(groups[0]), "the confined process lives on")
    wait_until(
        lambda: not list(Path(tempfile.gettempdir()).glob(f"{folders.PREFIX}{os.getpid()}-*")),
        "its folder is left",
    )


def test_folders_of_killed_services_are_removed() -> None:
    dead = 2**22 + 1  # beyond the largest process identifier
    left = Path(tempfile.mkdtemp(prefix=f"{folders.PREFIX}{dead}-"))
    (left / "file").write_text("x")
    with folders.private_folder() as mine:
        folders.remove_leftovers()
        assert mine.exists()
    assert not left.exists()


def test_no_more_tasks_at_once_than_allowed(monkeypatch: pytest.MonkeyPatch) -> None:
    from dohyo.service.errors import BusyError

    monkeypatch.setattr(runner, "WAIT_S", 0.01)
    slots = runner._slots["describe_agent"]
    held = 0
    while slots.acquire(blocking=False):
        held += 1
    try:
        with pytest.raises(BusyError, match="too many tasks 'describe_agent'"):
            attack("Sleep")
        assert held == 2
    finally:
        for _ in range(held):
            slots.release()
