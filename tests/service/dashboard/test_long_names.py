"""Agents whose names are as long as a service accepts: pages keep their width, and short names stay whole."""

from __future__ import annotations

import pytest
from playwright.sync_api import Page, Route

from tests.service.browsing import Visit, Visitor
from tests.service.dashboard.conftest import Site

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


@pytest.mark.parametrize("lost", [0, 12])
@pytest.mark.parametrize("width", [1440, 1280, 1024])
def test_all_columns_of_a_board_fit(visit: Visitor, site: Site, width: int, lost: int) -> None:
    site.fake.lost = {"all": lost} if lost else {}
    one = renamed(visit, width)
    page = one.go("/")
    assert page.locator("td[data-label='lost drives']").count() == (2 if lost else 0)
    assert page.evaluate(SPILLS) == []
    assert page.evaluate(HIDDEN) == []


def test_an_unbroken_title_widens_no_page_of_an_organiser(visit: Visitor) -> None:
    one = visit(width=390)
    document = {
        "name": "cup", "title": "a" * 150, "organiser": "lab", "teams": 1, "my_team": None, "may_organise": True,
        "announcements": [], "rules": "", "phases": [], "baselines": [],
    }  # fmt: skip
    one.page.route("**/v1/challenges/cup", lambda route: route.fulfill(json=document))
    one.page.route("**/v1/challenges/cup/*", lambda route: route.fulfill(json=[]))
    one.page.route("**/v1/agents?*", lambda route: route.fulfill(json={"items": [], "next": None}))
    one.page.route("**/v1/me", lambda route: route.fulfill(json={"owner": "lab", "role": "admin", "token": "tok-1"}))
    page = one.go("/challenges/cup/organise")
    assert "a" * 150 in page.locator("main").inner_text()
    assert page.evaluate("document.documentElement.scrollWidth") == 390


def test_a_short_name_stays_whole_beside_a_long_one(visit: Visitor) -> None:
    page: Page = renamed(visit, 1280).go("/")
    link = page.locator("tbody th a", has_text="autopilot")
    assert link.evaluate("element => element.getClientRects().length") == 1
