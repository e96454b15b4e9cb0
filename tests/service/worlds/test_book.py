"""Worlds that cannot begin: nothing of them stays, wherever their beginning is broken off."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest
from sqlalchemy import func, select

from dohyo.service.database.engine import Database
from dohyo.service.errors import BusyError
from dohyo.service.running.process import End, EpisodeProcess, Outcome
from dohyo.service.settings import Settings
from dohyo.service.simulating.order import WorldOrder, WorldRules
from dohyo.service.worlds.book import WorldBook
from dohyo.service.worlds.live import simulation
from dohyo.service.worlds.model import World
from tests.service.worlds.clients import scenario

RULES = WorldRules(deadline_s=1.0, late="repeat", pace="lockstep", speed=1.0)


def order(identifier: str) -> WorldOrder:
    return WorldOrder(name=identifier, scenario=scenario(1))


def worlds_of(database: Database) -> int:
    with database.reading() as session:
        return session.scalar(select(func.count()).select_from(World)) or 0


@pytest.mark.parametrize(("fault", "told"), [(OSError("no memory"), BusyError), (RuntimeError("odd"), RuntimeError)])
def test_a_process_that_does_not_start_leaves_no_world(
    fault: Exception, told: type[Exception], database: Database, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def start(process: EpisodeProcess) -> None:
        raise fault

    monkeypatch.setattr(EpisodeProcess, "start", start)
    book = WorldBook(Settings(data=tmp_path / "data", worlds_per_owner=1), database)
    for request in ("first", "second"):  # the first one takes no place
        with pytest.raises(told, match=str(fault)):
            asyncio.run(book.create("lab", order, RULES, (request, request)))
    assert worlds_of(database) == 0


def test_a_world_that_dies_before_its_first_tick_is_made_anew_by_the_same_request(
    database: Database, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Who is answered 503 sends the same request again, and must not get the dead world."""

    async def start(process: EpisodeProcess) -> None: ...

    async def drive(process: EpisodeProcess, order: WorldOrder) -> Outcome:
        return Outcome(End.DIED, "no memory")

    monkeypatch.setattr(EpisodeProcess, "start", start)
    monkeypatch.setattr(EpisodeProcess, "drive", drive)
    book = WorldBook(Settings(data=tmp_path / "data"), database)
    for _ in range(2):
        with pytest.raises(BusyError, match="could not be started: no memory"):
            asyncio.run(book.create("lab", order, RULES, ("key", "one")))
    assert worlds_of(database) == 0


def test_a_world_that_takes_too_long_to_begin_is_told_so_and_is_not_blamed_on_the_service_s_end(
    database: Database, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    async def start(process: EpisodeProcess) -> None: ...

    async def drive(process: EpisodeProcess, order: WorldOrder) -> Outcome:
        await asyncio.sleep(60.0)
        return Outcome(End.DIED)

    monkeypatch.setattr(EpisodeProcess, "start", start)
    monkeypatch.setattr(EpisodeProcess, "drive", drive)
    monkeypatch.setattr(simulation, "SHOW_S", 0.01)
    book = WorldBook(Settings(data=tmp_path / "data"), database)
    with pytest.raises(BusyError, match="for one tick"):
        asyncio.run(book.create("lab", order, RULES, ("key", "one")))
    assert worlds_of(database) == 0
    assert "the service ended" not in caplog.text
    assert "failed: the simulation took longer" in caplog.text


def test_a_request_that_is_given_up_leaves_no_world(
    database: Database, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun = asyncio.Event()

    async def start(process: EpisodeProcess) -> None:
        begun.set()
        await asyncio.sleep(60.0)

    monkeypatch.setattr(EpisodeProcess, "start", start)
    book = WorldBook(Settings(data=tmp_path / "data"), database)

    async def give_up() -> None:
        request = asyncio.create_task(book.create("lab", order, RULES, (None, "one")))
        await begun.wait()
        assert await asyncio.to_thread(worlds_of, database) == 1
        request.cancel()
        with pytest.raises(asyncio.CancelledError):
            await request

    asyncio.run(give_up())
    assert worlds_of(database) == 0


def test_a_world_whose_process_starts_as_the_service_ends_does_not_begin(
    database: Database, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    book, began = WorldBook(Settings(data=tmp_path / "data"), database), list[str]()

    async def start(process: EpisodeProcess) -> None:
        await book.stop()

    async def drive(process: EpisodeProcess, order: WorldOrder) -> Outcome:
        began.append(order.name)
        return Outcome(End.DIED)

    monkeypatch.setattr(EpisodeProcess, "start", start)
    monkeypatch.setattr(EpisodeProcess, "drive", drive)
    with pytest.raises(BusyError, match="the service is ending"):
        asyncio.run(book.create("lab", order, RULES, (None, "one")))
    assert (worlds_of(database), began) == (0, [])
