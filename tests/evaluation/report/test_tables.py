"""Tables and maps of the report in a real browser: sorted, filtered, searched, zoomed, the state in the address."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect

from dohyo.evaluation.records.specifications import InfractionKind
from tests.evaluation.report.test_report import at, drives, evaluation, hit, red, report
from tests.service.browsing import launched


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with launched() as one:
        yield one


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> str:
    """A report on two agents: 30 drives without a fault, and 30 drives with a growing number of infractions."""
    folder = tmp_path_factory.mktemp("report")
    beside = [at(InfractionKind.RED_LIGHT, x, y) for x, y in ((0.0, 20.0), (0.0, 24.0), (4.0, 20.0))]
    poor = drives("reckless", *[[hit(), *beside] if seed % 2 else [red()] for seed in range(30)])
    good = drives("careful", *[[] for _ in range(30)])
    path, _ = report(folder, evaluation(good, folder, "careful"), evaluation(poor, folder, "reckless"))
    return path.as_uri()


def opened(browser: Browser, address: str, width: int = 1280) -> Page:
    page = browser.new_context(viewport={"width": width, "height": 800}).new_page()
    page.goto(address)
    return page


def seeds(page: Page) -> list[int]:
    return [int(text) for text in page.locator("#drives tbody tr:visible td:nth-child(4)").all_inner_texts()]


def test_a_press_on_a_header_sorts_and_a_copied_address_shows_the_same(browser: Browser, address: str) -> None:
    page = opened(browser, address)
    header = page.locator("#drives th", has_text="seed")
    header.get_by_role("button").click()
    assert header.get_attribute("aria-sort") == "descending"
    assert seeds(page)[:4] == [29, 29, 28, 28]
    header.get_by_role("button").click()
    assert seeds(page)[:4] == [0, 0, 1, 1]
    assert seeds(opened(browser, page.url))[:4] == [0, 0, 1, 1]
    header.get_by_role("button").click()
    assert header.get_attribute("aria-sort") is None
    assert "drives.sort" not in page.url


def test_search_and_filter_leave_the_rows_that_fit_both(browser: Browser, address: str) -> None:
    page = opened(browser, address)
    page.locator("#drives").get_by_label("agent", exact=True).select_option("careful")
    page.locator("#drives").get_by_label("search").fill("CAREFUL 29")
    expect(page.locator("#drives tbody tr:visible")).to_have_count(1)
    expect(page.locator("#drives output")).to_have_text("1 of 60")
    expect(opened(browser, page.url).locator("#drives tbody tr:visible")).to_have_count(1)


def test_a_long_table_is_shown_in_part_and_a_linked_drive_always(browser: Browser, address: str) -> None:
    page = opened(browser, address + "#drive-0-29-0")
    expect(page.locator("#drives tbody tr:visible")).to_have_count(41)
    expect(page.locator("#drive-0-29-0")).to_be_visible()
    page.get_by_role("button", name="show all 60 rows").click()
    expect(page.locator("#drives tbody tr:visible")).to_have_count(60)
    phone = opened(browser, address, width=360)
    expect(phone.locator("#drives tbody tr:visible")).to_have_count(12)
    assert phone.evaluate("document.documentElement.scrollWidth") <= 360
    assert phone.evaluate("document.querySelector('#drives').offsetHeight") < 4000


@pytest.mark.parametrize("width", [360, 1280])
def test_long_names_stay_inside_the_page(browser: Browser, tmp_path: Path, width: int) -> None:
    names = ("a" * 80, "lane-keeper[shield=rss,localization=es-ekf,gnss=gnss_rtk]")
    found = [evaluation(drives(name, [red()], [hit()]), tmp_path, name[:8]) for name in names]
    page = opened(browser, report(tmp_path, *found)[0].as_uri(), width)
    assert page.evaluate("document.documentElement.scrollWidth") <= width


def test_zoomed_scales_span_the_values_and_say_so(browser: Browser, address: str) -> None:
    page = opened(browser, address)
    dots = page.locator("#scores td:nth-child(2) circle")
    whole = [float((dots.nth(i).get_attribute("cx") or "").rstrip("%")) for i in range(2)]
    page.locator("#scores .zoom").click()
    zoomed = [float((dots.nth(i).get_attribute("cx") or "").rstrip("%")) for i in range(2)]
    assert zoomed[0] - zoomed[1] > whole[0] - whole[1]
    assert page.locator("#scores .scale-ends").first.inner_text().split() != ["0", "100"]
    assert "scores.zoom=1" in page.url


def test_a_mark_on_the_map_is_where_it_happened_and_counts_those_it_covers(browser: Browser, address: str) -> None:
    page = opened(browser, address)
    marks = page.locator(".spot.red_light:not(.behind)")
    expect(marks).to_have_count(1)
    expect(marks.locator("text")).to_have_text("60")
    assert marks.get_attribute("transform") == "translate(0.0 -20.0)"
    marks.locator(".shape").click()
    marks.first.locator(".shape").click()
    expect(marks).to_have_count(3)
    page.locator("input[name=red_light]").uncheck()
    expect(page.locator(".spot.red_light:visible")).to_have_count(0)
