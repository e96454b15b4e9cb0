"""Tables of the dashboard in a real browser: sorted, filtered and searched, with the state in the address."""

from __future__ import annotations

import pytest
from playwright.sync_api import Page, expect

from tests.service.dashboard.conftest import Site, Visitor

READY = "main[data-state=ready]"


def names(page: Page, table: str = "tbody") -> list[str]:
    return page.locator(f"{table} tr:visible > th").all_inner_texts()


def test_the_address_holds_order_filter_and_search_of_a_table(visit: Visitor) -> None:
    page = visit().go("/evaluations/ev-reckless")
    page.get_by_role("button", name="seed").click()
    page.get_by_label("ending", exact=True).select_option("deviated from the route")
    page.get_by_label("search").fill("right")
    assert names(page) == ["right-to-east", "right-to-east"]
    page.reload()
    page.wait_for_selector(READY)
    assert names(page) == ["right-to-east", "right-to-east"]
    assert page.locator("tbody tr:visible td:nth-child(2)").all_inner_texts() == ["1", "0"]
    expect(page.locator("output")).to_have_text("2 of 12")


@pytest.mark.parametrize("path", ["/", "/evaluations", "/agents/reckless", "/evaluations/ev-reckless/map"])
def test_every_table_has_headers_that_sort(visit: Visitor, path: str) -> None:
    page = visit().go(path)
    for i in range(page.locator("table").count()):
        table = page.locator("table").nth(i)
        header = table.locator("th .sorter").first
        header.click()
        assert table.locator("th").first.get_attribute("aria-sort") in ("ascending", "descending")


def test_what_a_reader_has_chosen_stays_while_episodes_end(visit: Visitor, site: Site) -> None:
    page = visit().go("/evaluations/ev-live")
    page.get_by_label("search").fill("east")
    before = names(page)
    page.get_by_label("search").focus()
    ended = site.fake.queued[0]
    site.fake.queued.remove(ended)
    site.fake.events.append({"episode": ended, "status": "done"})
    expect(page.locator("#tiles")).to_contain_text("5 / 12")
    page.wait_for_timeout(1800)  # the page reads the episodes again 1.5 s after the last event
    assert sorted(names(page)) == sorted(before)
    assert page.evaluate("document.activeElement.type") == "search"


def test_twelve_drives_fit_on_six_screens_of_a_phone(visit: Visitor) -> None:
    page = visit(width=360, height=740).go("/evaluations/ev-reckless")
    assert page.locator("#episodes").evaluate("element => element.offsetHeight") < 6 * 740


def test_side_by_side_replays_carry_the_names_of_their_submissions(visit: Visitor, site: Site) -> None:
    page = visit().go("/compare?evaluation=ev-autopilot&evaluation=ev-reckless&scenario=right-to-south-s0")
    expect(page.locator(".timelines h3")).to_have_text(["autopilot", "reckless"])


def test_the_comparison_has_a_matrix_of_missions_by_agents(visit: Visitor) -> None:
    page = visit().go("/compare?evaluation=ev-autopilot&evaluation=ev-reckless")
    matrix = page.locator("#matrix")
    expect(matrix.locator("tbody tr")).to_have_count(6)
    worst = matrix.locator("tbody tr", has_text="right-to-south").locator("td").nth(1)
    expect(worst).to_contain_text("11.5 n=2")
    matrix.locator("th .sorter").nth(2).click()
    assert "missions.sort=-reckless-2" in page.url


def test_the_score_of_each_version_is_drawn_and_zooms(visit: Visitor, site: Site) -> None:
    site.fake.second = True
    page = visit().go("/agents/reckless")
    chart = page.locator(".versions-chart")
    expect(chart.locator("a")).to_have_count(2)
    assert "v2: 30.1" in str(chart.get_attribute("aria-label"))
    before = chart.locator(".reach").first.bounding_box()
    page.get_by_role("button", name="zoom the scale", exact=True).click()
    after = chart.locator(".reach").first.bounding_box()
    assert before is not None
    assert after is not None
    assert after["height"] > 2 * before["height"]


def test_plots_of_a_replay_zoom_to_the_seconds_around_now(visit: Visitor) -> None:
    page = visit().go("/episodes/reckless-right-to-south-s0#t=14")
    plot = page.locator(".plot:not(.scrubber) svg").first
    whole = str(plot.get_attribute("viewBox")).split()
    page.get_by_label("plots show").select_option("5")
    expect(plot).not_to_have_attribute("viewBox", " ".join(whole))
    start, _, width, height = map(float, str(plot.get_attribute("viewBox")).split())
    assert (start, width) == (115, 50)
    assert height < float(whole[3])
