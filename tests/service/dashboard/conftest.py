"""A browser without any network but the fake service, which runs in a thread of this process."""

from __future__ import annotations

import shutil
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

import pytest
import uvicorn
from playwright.sync_api import Browser, ConsoleMessage, Page, Route, sync_playwright

from tests.service.dashboard import fake as fakes

CHROMIUM = shutil.which("chromium")
READY = "main:not([data-state=loading])"
START_S = 10.0


@dataclass
class Site:
    """The fake service and what it knows."""

    origin: str
    fake: fakes.Fake


@dataclass
class Visit:
    """A page in a browser.

    Attributes:
        page: Playwright's.
        origin: Of the service.
        complaints: What scripts said as warnings or errors, and what they threw.
        foreign: Requests to any other host; they were blocked.
    """

    page: Page
    origin: str
    complaints: list[str] = field(default_factory=list)
    foreign: list[str] = field(default_factory=list)

    def go(self, path: str) -> Page:
        """Opens a path and waits until it is drawn."""
        self.page.goto(self.origin + path)
        self.page.wait_for_selector(READY)
        return self.page


Visitor = Callable[..., Visit]


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


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    if CHROMIUM is None:
        pytest.skip("no chromium on this machine to open the dashboard with")
    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox", "--disable-gpu"])
        yield chromium
        chromium.close()


@pytest.fixture
def visit(browser: Browser, site: Site) -> Iterator[Visitor]:
    """Opens browsers with their own cookies: `visit(width=360, color_scheme="dark")`."""
    contexts = []

    def begin(width: int = 1280, height: int = 900, **options: Any) -> Visit:
        context = browser.new_context(viewport={"width": width, "height": height}, **options)
        contexts.append(context)
        one = Visit(context.new_page(), site.origin)
        one.page.set_default_timeout(10_000)

        def pass_own(route: Route) -> None:
            if route.request.url.startswith((site.origin, "data:", "blob:")):
                route.continue_()
                return
            one.foreign.append(route.request.url)
            route.abort()

        context.route("**/*", pass_own)
        one.page.on("pageerror", lambda error: one.complaints.append(str(error)))

        def note(said: ConsoleMessage) -> None:
            if said.type in ("error", "warning"):
                one.complaints.append(said.text)

        one.page.on("console", note)
        return one

    yield begin
    for context in contexts:
        context.close()
