from __future__ import annotations

import secrets
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser
from pydantic import SecretStr

from dohyo.service.database.engine import Database
from tests.service import browsing, certificates, postgres, tables
from tests.service.harness import Harness, running
from tests.service.served import Service
from tests.service.shop import Shop

MakeService = Callable[..., Service]


@pytest.fixture(scope="session")
def postgres_server() -> Iterator[str]:
    with postgres.running() as url:
        yield url


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    """For one file only: while Playwright lives, asyncio believes that a loop runs in this thread."""
    with browsing.launched() as chromium:
        yield chromium


@pytest.fixture(scope="module")
def certified(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A self-signed certificate of this machine, and its key."""
    return certificates.make(tmp_path_factory.mktemp("tls"))


@pytest.fixture(params=["sqlite", "postgresql"])
def empty_database_url(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    """A database of each kind, without tables."""
    if request.param == "sqlite":
        return f"sqlite:///{tmp_path / 'empty.db'}"
    return postgres.fresh_database(request.getfixturevalue("postgres_server"), f"empty_{secrets.token_hex(6)}")


@pytest.fixture(params=["sqlite", "postgresql"])
def database_url(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    """The same with its tables."""
    if request.param == "sqlite":
        return tables.sqlite_with_tables(tmp_path / "dohyo.db")
    return tables.postgresql_with_tables(request.getfixturevalue("postgres_server"))


@pytest.fixture
def database(database_url: str) -> Iterator[Database]:
    """The same, opened."""
    opened = Database(database_url)
    yield opened
    opened.close()


@pytest.fixture
def service(tmp_path: Path) -> Iterator[Harness]:
    """A service on SQLite that everybody may read, and that drives nothing."""
    with running(tmp_path / "data") as harness:
        yield harness


@pytest.fixture
def stored(tmp_path: Path, database_url: str) -> Iterator[Harness]:
    """The same on SQLite and on PostgreSQL."""
    with running(tmp_path / "data", database=SecretStr(database_url)) as harness:
        yield harness


@pytest.fixture
def private(tmp_path: Path) -> Iterator[Harness]:
    """The same where only owners see what is theirs."""
    with running(tmp_path / "data", public=False) as harness:
        yield harness


@pytest.fixture
def shop(tmp_path: Path) -> Iterator[Shop]:
    """A service with stored evaluations, read through its interface."""
    made = Shop(tmp_path / "data")
    yield made
    made.services.database.close()


@pytest.fixture
def private_shop(tmp_path: Path) -> Iterator[Shop]:
    """The same where only owners see what is theirs."""
    made = Shop(tmp_path / "data", public=False)
    yield made
    made.services.database.close()


@pytest.fixture
def make_service(tmp_path: Path) -> Iterator[MakeService]:
    """Makes a service on data of its own, not started yet."""
    made: list[Service] = []

    def make(**settings: object) -> Service:
        made.append(Service(tmp_path / f"data-{len(made)}", **settings))
        return made[-1]

    yield make
    for service in made:
        service.close()


@pytest.fixture(scope="module")
def running_service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    """A running service that the tests of a file share, each with agents of its own."""
    shared = Service(tmp_path_factory.mktemp("data"), processes=1, remote_episodes=2)
    shared.start()
    yield shared
    shared.close()
