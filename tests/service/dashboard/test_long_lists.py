"""Lists that are longer than a page shows: a page says how many it shows."""

from __future__ import annotations

from typing import Any
from urllib.parse import parse_qs, urlsplit

from playwright.sync_api import Route, expect

from tests.service.browsing import Visitor
from tests.service.dashboard.test_open_pages import FAR, challenge, phase

PLACES = 1234


def long_board(route: Route) -> None:
    """Answers as the service does from a board of many agents."""
    query = parse_qs(urlsplit(route.request.url).query)
    limit = int(query.get("limit", ["100"])[0])
    document = route.fetch(url=route.request.url.partition("?")[0] + "?benchmark=quickstart").json()
    first = document["rows"][0]
    rows = [first | {"agent": f"agent-{place:04}", "rank": place, "above": None} for place in range(1, limit + 1)]
    route.fulfill(json=document | {"rows": rows, "total": PLACES, "next": "more"})


def test_a_long_board_shows_five_hundred_places_and_says_of_how_many(visit: Visitor) -> None:
    one = visit()
    expect(one.go("/").locator(".under")).not_to_contain_text("Shown are")
    one.page.route("**/v1/leaderboard?*", long_board)
    page = one.go("/")
    expect(page.locator(".under")).to_contain_text("Shown are the first 500 of 1,234 places; the CSV has all.")
    page.get_by_role("button", name="show all 500 rows").click()
    expect(page.locator("tbody tr:visible")).to_have_count(500)
    grey = page.locator(".dot-agent").evaluate_all(
        "dots => dots.filter((dot) => dot.parentElement.style.getPropertyValue('--agent') === 'var(--quiet)').length"
    )
    assert grey == 0
    assert one.complaints == []


def test_the_long_board_of_a_phase_says_so(visit: Visitor) -> None:
    one = visit()
    challenge(one.page, phase("open", FAR) | {"board_visible": True})
    one.page.route("**/v1/leaderboard?*", long_board)
    page = one.go("/challenges/cup")
    expect(page.locator("#board")).to_contain_text("Shown are the first 500 of 1,234 places")


def test_the_page_of_an_agent_says_of_how_many_agents_a_median_is(visit: Visitor) -> None:
    one = visit()
    page = one.go("/agents/reckless")
    expect(page.get_by_role("columnheader", name="median of all agents")).to_be_visible()
    page.route("**/v1/leaderboard?*", long_board)
    one.go("/agents/reckless")
    expect(page.get_by_role("columnheader", name="median of the first 500 agents")).to_be_visible()


def test_a_list_that_never_ends_is_read_in_part_and_the_page_says_so(visit: Visitor) -> None:
    one = visit()
    expect(one.go("/evaluations").locator("main")).not_to_contain_text("reads the first")
    one.page.route("**/v1/evaluations?*", endless)
    page = one.go("/evaluations")
    expect(page.locator("main")).to_contain_text("This page reads the first 500 evaluations only; the API has all.")
    assert one.complaints == []


def endless(route: Route) -> None:
    """Answers with a whole page of a list, and says that there are more."""
    document: dict[str, Any] = route.fetch(url=route.request.url.partition("?")[0]).json()
    items = (document["items"] * 200)[:200]
    route.fulfill(json={"items": items, "next": "more"})
