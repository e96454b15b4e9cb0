"""A real browser that reaches one service and nothing else, and remembers what its console said."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import pytest
from playwright.sync_api import Browser, ConsoleMessage, Page, Route, expect, sync_playwright

CHROMIUM = shutil.which("chromium")
READY = "main:not([data-state=loading])"
PATIENCE_MS = 120_000
expect.set_options(timeout=PATIENCE_MS)


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


def drawn(page: Page) -> None:
    """Waits until all that was asked for is drawn: what asks for a frame later is drawn later."""
    page.evaluate("() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() => done())))")


@contextmanager
def launched() -> Iterator[Browser]:
    """Debian's chromium."""
    if CHROMIUM is None:
        pytest.skip("no chromium on this machine to open the dashboard with")
    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox", "--disable-gpu"])
        yield chromium
        chromium.close()


@contextmanager
def visiting(browser: Browser, origin: str) -> Iterator[Visitor]:
    """Opens windows with their own cookies: `begin(width=360, color_scheme="dark")`."""
    contexts = []

    def begin(width: int = 1280, height: int = 900, **options: Any) -> Visit:
        context = browser.new_context(viewport={"width": width, "height": height}, **options)
        contexts.append(context)
        one = Visit(context.new_page(), origin)
        one.page.set_default_timeout(PATIENCE_MS)

        def pass_own(route: Route) -> None:
            if route.request.url.startswith((origin, "data:", "blob:")):
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
