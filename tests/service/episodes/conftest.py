"""Services in processes, ended whatever happens."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.service.episodes.served import Service

MakeService = Callable[..., Service]


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
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    """A running service that the tests of a file share, each with agents of its own."""
    shared = Service(tmp_path_factory.mktemp("data"), processes=2, remote_episodes=4)
    shared.start()
    yield shared
    shared.close()
