"""Whether an ego was at fault in a collision: in words wherever infractions are listed, and by a hollow mark."""

from __future__ import annotations

import json

import pytest
from playwright.sync_api import Page, Route, expect

from tests.service.browsing import Visitor
from tests.service.dashboard.conftest import Site
from tests.service.dashboard.fake import stored

EPISODE = "reckless-right-to-south-s0"
HIT = "pedestrian hit (not at fault) at 12.7 s"


@pytest.fixture(autouse=True)
def innocent(site: Site) -> None:
    """The ego was not at fault in the first collision of its drive; in the others it was."""
    record = site.fake.records[EPISODE]
    (ego,) = record.egos
    red, hit, *others = ego.infractions
    assert (red.at_fault, hit.at_fault, others[1].at_fault) == (None, True, True)
    changed = (red, hit.model_copy(update={"at_fault": False}), *others)
    egos = (ego.model_copy(update={"infractions": changed}),)
    site.fake.records[EPISODE] = record.model_copy(update={"egos": egos})


def replay(visit: Visitor) -> Page:
    """The page of the episode, with the replay of the changed record."""
    document = json.loads(json.dumps(stored("replay-reckless")))
    document["egos"][0]["infractions"][1]["at_fault"] = False

    def answer(route: Route) -> None:
        route.fulfill(json=document)

    one = visit()
    one.page.route("**/v1/episodes/*/replay", answer)
    return one.go(f"/episodes/{EPISODE}")


def test_a_replay_says_it_in_its_list_on_its_timeline_and_at_each_jump(visit: Visitor) -> None:
    page = replay(visit)
    listed = page.locator(".infractions .detail")
    expect(listed.nth(0)).not_to_contain_text("fault")
    expect(listed.nth(1)).to_contain_text("not at fault")
    expect(listed.nth(3)).to_contain_text("· at fault")
    moments = page.locator(".timeline .moment")
    assert moments.nth(0).get_attribute("title") == "red light run at 12.6 s"
    assert moments.nth(1).get_attribute("title") == HIT
    page.keyboard.press("i")
    page.keyboard.press("i")
    expect(page.locator(".controls [role=status]")).to_have_text(HIT)


def test_an_evaluation_says_it_on_the_marks_of_its_routes(visit: Visitor) -> None:
    page = visit().go("/evaluations/ev-reckless")
    marks = page.locator("#episodes tbody tr").first.locator(".route a")
    assert marks.locator("title").all_text_contents()[:2] == ["red light run at 12.6 s", HIT]
    assert marks.evaluate_all("marks => marks.map((mark) => mark.classList.contains('innocent'))") == [
        *(False, True, False, False, False)
    ]
    expect(page.locator(".marks-key")).to_contain_text("a hollow mark: not at fault")


def test_the_map_of_infractions_says_it_in_its_table_and_filters_by_it(visit: Visitor) -> None:
    page = visit().go("/evaluations/ev-reckless/map")
    page.get_by_label("fault", exact=True).select_option("not at fault")
    row = page.locator("tbody tr:visible")
    expect(row).to_have_count(1)
    expect(row.locator("td[data-label=fault]")).to_have_text("not at fault")
    expect(row.locator(".mark.innocent")).to_have_count(1)
    page.get_by_label("fault", exact=True).select_option("not judged")
    expect(row.filter(has_text="pedestrian hit")).to_have_count(0)
    page.get_by_label("fault", exact=True).select_option("at fault")
    expect(row.filter(has_text="hit")).to_have_count(9)
