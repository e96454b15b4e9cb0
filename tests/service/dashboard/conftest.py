"""A browser without any network but the fake service, which runs in a thread of this process."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass

import pytest
import uvicorn
from playwright.sync_api import Browser

from tests.service.browsing import Visitor, visiting
from tests.service.dashboard import fake as fakes

START_S = 120.0


@dataclass
class Site:
    """The fake service and what it knows."""

    origin: str
    fake: fakes.Fake


@pytest.fixture(scope="session")
def served() -> Iterator[Site]:
    app = fakes.create()
    server = uvicorn.Server(uvicorn.Config(app, port=0, log_level="critical", timeout_graceful_shutdown=1))
    thread = threading.Thread(target=server.run, daemon=True)
    thread.start()
    deadline = time.monotonic() + START_S
    while not server.started:
        assert time.monotonic() < deadline, "the fake service did not start"
        time.sleep(0.01)
    port = server.servers[0].sockets[0].getsockname()[1]
    yield Site(f"http://127.0.0.1:{port}", app.state.fake)
    server.should_exit = True
    thread.join(START_S)


@pytest.fixture
def site(served: Site) -> Iterator[Site]:
    """The service as it is at first, whatever a test before did to it."""
    fresh = fakes.Fake()
    served.fake.__dict__.update(fresh.__dict__)
    yield served
    served.fake.queued.clear()  # ends open streams


@pytest.fixture
def visit(browser: Browser, site: Site) -> Iterator[Visitor]:
    """Opens browsers with their own cookies: `visit(width=360, color_scheme="dark")`."""
    with visiting(browser, site.origin) as begin:
        yield begin
