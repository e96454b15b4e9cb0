"""Sections whose request fails while the rest of their page is read: they say why, and offer to load the page again."""

from __future__ import annotations

import pytest
from playwright.sync_api import expect

from dohyo.service.episodes.views import AttemptView
from dohyo.service.evaluations.model import AttemptOutcome
from tests.service.browsing import Visitor
from tests.service.dashboard.conftest import Site
from tests.service.dashboard.fake import WHEN

METRICS, WAIT = "**/v1/evaluations/*/metrics", "too many requests; again in 30 s"
AGENT, EVALUATION = "/agents/reckless", "/evaluations/ev-reckless"
PAIR = "/compare?evaluation=ev-autopilot&evaluation=ev-reckless"
GONE = AttemptView(
    number=1, started=WHEN, ended=WHEN, outcome=AttemptOutcome.WORKER_GONE, why="silent", charged=True, processor_s=1.5
)
SECTIONS = {
    "scores": (EVALUATION, METRICS, "Scores"),
    "attempts": (EVALUATION, "**/v1/episodes/*/attempts*", "Attempts and failures"),
    "benchmark": (AGENT, METRICS, "quickstart"),
    "median": (AGENT, "**/v1/leaderboard?*", "Median of all agents"),
    "submissions": (AGENT, "**/v1/agents/reckless/submissions*", "Versions"),
    "versions": (AGENT, "**/v1/evaluations/ev-reckless/metrics", "driving score DS over versions"),
    "missions": (PAIR, "**/v1/evaluations/*/episodes?*", "Missions by agents"),
}


@pytest.mark.parametrize(("path", "pattern", "title"), SECTIONS.values(), ids=SECTIONS)
def test_a_section_that_was_refused_says_so_and_loads_again(
    visit: Visitor, site: Site, path: str, pattern: str, title: str
) -> None:
    site.fake.second = True
    if title.startswith("Attempts"):
        site.fake.attempts = {"reckless-right-to-south-s0": [GONE] * 2}
    one = visit()
    one.page.route(pattern, lambda route: route.fulfill(status=429, json={"detail": WAIT}))
    page = one.go(path)
    section = page.locator("section", has=page.get_by_role("heading", name=title, exact=True)).last
    expect(section.get_by_role("alert")).to_have_text(f"This could not be read: 429, {WAIT}")
    again = section.get_by_role("button", name="load again")
    site.fake.attempts.clear()
    page.unroute(pattern)
    with page.expect_navigation():
        again.click()
    page.wait_for_selector("main[data-state=ready]")
    expect(page.get_by_role("alert")).to_have_count(0)


def test_scores_that_may_not_be_read_say_why_and_offer_no_second_try(visit: Visitor) -> None:
    one = visit()
    why = "the records of this ranking are secret"
    one.page.route(METRICS, lambda route: route.fulfill(status=403, json={"detail": why}))
    scores = one.go(EVALUATION).locator("#scores")
    expect(scores.get_by_role("alert")).to_contain_text(why)
    expect(scores.get_by_role("button")).to_have_count(0)
