from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.service.reading.shop import Shop


@pytest.fixture
def shop(tmp_path: Path) -> Iterator[Shop]:
    made = Shop(tmp_path / "data")
    yield made
    made.services.database.close()


@pytest.fixture
def private_shop(tmp_path: Path) -> Iterator[Shop]:
    made = Shop(tmp_path / "data", public=False)
    yield made
    made.services.database.close()
