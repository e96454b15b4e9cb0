"""One service for the worlds of a file."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.service.serving import Served, serving
from tests.service.worlds.clients import Client


@pytest.fixture(scope="package")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    with serving(tmp_path_factory.mktemp("worlds") / "data") as one:
        yield one


@pytest.fixture
def client(served: Served) -> Iterator[Client]:
    """The administrator, who ends all worlds afterwards."""
    one = Client(served)
    yield one
    for world in one.send("GET", "/v1/worlds").json()["items"]:
        if world["finished"] is None:
            one.order(world["id"], "end")
