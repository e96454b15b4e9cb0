"""Comparisons of days, mornings and lots in a real browser: each with its own words, measures and units."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any

from playwright.sync_api import Page, expect

from dohyo.evaluation.freeway.benchmark import load_traffic
from dohyo.evaluation.freeway.day import DAY, DayRecord
from dohyo.evaluation.freeway.morning import MORNING, MorningRecord, MorningScenario
from dohyo.evaluation.parking.benchmark import LOT
from dohyo.evaluation.records.record import AgentInfo
from dohyo.service.boards.comparison import compare_entries
from dohyo.service.boards.leaderboard import Entry
from dohyo.service.evaluations import scoring
from tests.service.browsing import Visitor
from tests.service.dashboard.fake import VERSION, WHEN
from tests.service.dashboard.test_days import HARD
from tests.service.dashboard.test_lots import drives as lots

Drives = list[scoring.Drive]
AGENT = AgentInfo(name="mine", entry="remote:mine", track="sensors", sensors=(), control="target_speeds")
DISSIPATION = load_traffic("dissipation")
TITLES = "elements => elements.map((element) => element.title)"
DRIVING = {"DS", "driving", "drive", "mission", "scenario"}


def days(factor: float) -> Drives:
    """Days whose squared error is a multiple of their number."""
    found: Drives = []
    for scenario in HARD.scenarios():
        measures = dict.fromkeys(scoring.FORECAST_SCORES, factor * scenario.number)
        record = DayRecord(scenario=scenario, benchmark=("forecast-hard", VERSION), agent=AGENT, measures=measures)
        found += drives_of(scenario.name, DAY, 1, scoring.summary_of_day(record))
    return found


def mornings(factor: float) -> Drives:
    """Mornings whose speeds spread by a multiple of their seed."""
    found: Drives = []
    for seed in (1, 2, 3):
        scenario = MorningScenario(benchmark=DISSIPATION, seed=seed)
        outcome = dict.fromkeys(scoring.MORNING_SCORES, factor * seed)
        record = MorningRecord(scenario=scenario, benchmark=("dissipation", VERSION), agent=AGENT, outcome=outcome)
        found += drives_of(MORNING, MORNING, seed, scoring.summary_of_morning(record))
    return found


def parked(factor: float) -> Drives:
    """Lots of one agent, or of one that comes after the other's in the alphabet and parks nothing."""
    found: Drives = []
    for drive in lots():
        summary = scoring.summary_of_lot(drive.record)
        if factor > 1:
            summary["egos"][0]["parking"] |= dict.fromkeys(("parked", "aligned"), 0)
        found += drives_of(LOT, LOT, drive.record.seed, summary)
    return found


def drives_of(name: str, cell: str, seed: int, summary: dict[str, Any]) -> Iterable[scoring.Drive]:
    return [scoring.Drive(f"ep-{name}-{seed}", name, cell, seed, facts) for facts in summary["egos"]]


def compare(visit: Visitor, make: Callable[[float], Drives], metric: str) -> Page:
    """The page that compares two runs, of which the second has twice the measures."""
    runs = {name: make(factor) for name, factor in (("alpha", 1.0), ("beta", 2.0))}
    entries = [
        Entry(
            f"ev-{name}", f"su-{name}", name, 1, "lab", "remote", "sensors", "made", VERSION, (0,), WHEN, tuple(found)
        ) for name, found in runs.items()
    ]  # fmt: skip
    one = visit()
    document = compare_entries(entries, metric)
    one.page.route("**/v1/comparison?*", lambda route: route.fulfill(json=document))
    for name, found in runs.items():
        items = [
            {"id": drive.episode, "scenario": drive.scenario, "cell": drive.cell, "seed": drive.seed, "status": "done",
             "summary": {"egos": [dict(drive.facts)]}}
            for drive in found
        ]  # fmt: skip
        answer = {"items": items, "next": None}
        one.page.route(f"**/v1/evaluations/ev-{name}/episodes?*", answering(answer))
    page = one.go("/compare?evaluation=ev-alpha&evaluation=ev-beta")
    assert one.complaints == []
    return page


def answering(document: Any) -> Callable[[Any], None]:
    return lambda route: route.fulfill(json=document)


def headers(page: Page, section: str) -> Sequence[str]:
    texts = page.locator("section", has=page.locator("h2", has_text=section)).locator("thead th").all_inner_texts()
    return [" ".join(text.split()) for text in texts]


def test_days_are_compared_by_their_error_and_have_no_replays(visit: Visitor) -> None:
    page = compare(visit, days, "mse")
    assert headers(page, "Where they differ most") == [
        "day", "seed", "alpha error of three minutes, × 10³", "beta error of three minutes, × 10³", "spread",
    ]  # fmt: skip
    expect(page.locator("h2").nth(1)).to_have_text("Differences on the same days (A minus B)")
    matrix = page.locator("#matrix")
    expect(matrix.locator("h2")).to_have_text("Days by agents")
    expect(matrix).to_contain_text("the better, the stronger the shade")
    assert headers(page, "Days by agents")[1] == "alpha v1 error of three minutes, × 10³"
    assert matrix.locator("tbody tr").first.inner_text().split() == ["day-0001", "1.00", "n=1", "2.00", "n=1"]
    assert told(page) & DRIVING == set()


def test_mornings_are_compared_by_the_spread_of_speeds_and_have_no_replays(visit: Visitor) -> None:
    page = compare(visit, mornings, "speed_std_mps")
    assert headers(page, "Where they differ most") == [
        "morning", "seed", "alpha spread of speeds, m/s", "beta spread of speeds, m/s", "spread",
    ]  # fmt: skip
    expect(page.locator("h2").nth(1)).to_have_text("Differences on the same mornings (A minus B)")
    expect(page.locator("#matrix")).to_be_empty()
    assert told(page) & DRIVING == set()


def test_lots_are_compared_by_the_karts_that_parked_and_have_replays(visit: Visitor) -> None:
    page = compare(visit, parked, "success")
    assert headers(page, "Where they differ most") == [
        "lot", "seed", "alpha success, %", "beta success, %", "spread", "replays",
    ]  # fmt: skip
    expect(page.locator("h2").nth(1)).to_have_text("Differences on the same lots (A minus B)")
    expect(page.get_by_role("rowheader", name="contacts, lower is better")).to_be_visible()
    assert told(page) & DRIVING == set()


def told(page: Page) -> set[str]:
    """Words of the page and of its titles, without the last letter of plurals."""
    page.wait_for_selector("main[data-state=ready]")
    text = page.locator("main").inner_text() + " ".join(page.locator("main [title]").evaluate_all(TITLES))
    return {word.strip(".,;:()").removesuffix("s") if len(word) > 2 else word for word in text.split()}
