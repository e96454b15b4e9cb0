"""Agents whose names are as long as a service accepts: pages keep their width, and short names stay whole."""

from __future__ import annotations

import pytest
from playwright.sync_api import Page, Route

from tests.service.browsing import Visit, Visitor

LONG = "reckless-with-a-very-long-name-" + "0123456789" * 4
PAGES = {
    "board": "/",
    "agent": "/agents/reckless",
    "compare": "/compare?evaluation=ev-autopilot&evaluation=ev-reckless",
    "evaluations": "/evaluations",
    "evaluation": "/evaluations/ev-reckless",
    "episode": "/episodes/reckless-right-to-south-s0",
}
SPILLS = """() => [...document.querySelectorAll("main, main *")]
  .filter((one) => one.scrollWidth > one.clientWidth + 1 && /auto|scroll/.test(getComputedStyle(one).overflowX))
  .filter((one) => one.localName !== "pre")
  .map((one) => `${one.localName}.${one.className} ${one.scrollWidth} > ${one.clientWidth}`)"""
"""Frames that scroll sideways."""
HIDDEN = """() => [...document.querySelectorAll("main td, main th, main h1, main h3, main .byline")]
  .filter((one) => one.clientWidth && one.scrollWidth > one.clientWidth + 1)
  .map((one) => `${one.localName}.${one.className} ${one.textContent}`)"""
"""Places with text that is drawn over their neighbours."""


def renamed(visit: Visitor, width: int) -> Visit:
    """A window in which the agent "reckless" has a long name."""
    one = visit(width=width)

    def answer(route: Route) -> None:
        found = route.fetch(url=route.request.url.replace(LONG, "reckless"))
        text = found.text().replace('"agent":"reckless"', f'"agent":"{LONG}"')
        route.fulfill(response=found, body=text.replace('"name":"reckless"', f'"name":"{LONG}"'))

    for path in ("leaderboard?*", "agents/*", "comparison?*", "evaluations?*", "evaluations/*", "episodes/reckless-*"):
        one.page.route(f"**/v1/{path}", answer)
    one.page.route("**/agents/reckless", subject_renamed)
    return one


def subject_renamed(route: Route) -> None:
    if "/v1/" in route.request.url:
        route.fallback()
        return
    found = route.fetch()
    route.fulfill(response=found, body=found.text().replace('"reckless"', f'"{LONG}"'))


@pytest.mark.parametrize("width", [1280, 390])
@pytest.mark.parametrize("path", PAGES.values(), ids=PAGES)
def test_a_long_name_breaks_and_widens_no_page(visit: Visitor, path: str, width: int) -> None:
    one = renamed(visit, width)
    page = one.go(path)
    assert LONG in page.locator("main").inner_text()
    assert page.evaluate("document.documentElement.scrollWidth") == width
    assert page.evaluate(SPILLS) == []
    assert page.evaluate(HIDDEN) == []


def test_a_short_name_stays_whole_beside_a_long_one(visit: Visitor) -> None:
    page: Page = renamed(visit, 1280).go("/")
    link = page.locator("tbody th a", has_text="autopilot")
    assert link.evaluate("element => element.getClientRects().length") == 1
