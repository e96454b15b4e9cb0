"""Days of forecasts in a real browser: the board, the days of a run, and one day, which has no replay."""

from __future__ import annotations

import json
from typing import Any

import pytest
from playwright.sync_api import Page as BrowserPage
from playwright.sync_api import Route, expect

from dohyo.evaluation.families import FORECASTING_CONTROL
from dohyo.evaluation.freeway.benchmark import load_forecasting
from dohyo.evaluation.freeway.day import DAY, METRICS, DayRecord
from dohyo.evaluation.records.record import AgentInfo
from dohyo.service.boards.leaderboard import Entry
from dohyo.service.episodes.reading_views import EpisodeDetail
from dohyo.service.evaluations import scoring
from dohyo.service.evaluations.metrics import as_document
from dohyo.service.evaluations.views import EvaluationView
from tests.service.browsing import Visitor
from tests.service.dashboard.fake import VERSION, WHEN, board_rows

HARD = load_forecasting("forecast-hard")


def details() -> list[EpisodeDetail]:
    """Four days, the last of which the forecaster failed."""
    agent = AgentInfo(name="mine", entry="remote:mine", track="sensors", sensors=(), control=FORECASTING_CONTROL)
    found = []
    for scenario in HARD.scenarios():
        measures = {one.key: 4.0 * scenario.number**2 for one in METRICS}
        facts: dict[str, Any] = {"measures": measures, "forecasts": 430} if scenario.number < 4 else {"failure": "NaN"}
        record = DayRecord(scenario=scenario, benchmark=("forecast-hard", VERSION), agent=agent, **facts).sealed()
        found.append(
            EpisodeDetail(
                id=f"ep-{scenario.number}", evaluation="ev-days", position=scenario.number - 1, scenario=scenario.name,
                cell=DAY, seed=1, attempts=1, failure=None, started=WHEN, finished=WHEN, status="done",
                record_hash=record.record_hash, summary=scoring.summary_of_day(record), agent="mine", agent_version=1,
                egos={}, benchmark="forecast-hard", benchmark_version=VERSION, rules=None, network=None,
            )
        )  # fmt: skip
    return found


def answers() -> dict[str, Any]:
    """Answers of a service with one run, by the end of their paths."""
    days = details()
    drives = tuple(scoring.Drive(one.id, str(one.scenario), DAY, 1, (one.summary or {})["egos"][0]) for one in days[:3])
    run = ("ev-days", "su-1", "mine", 1, "lab", "remote", "sensors", "forecast-hard", VERSION, (1,), WHEN, drives)
    evaluation = EvaluationView(
        id="ev-days", owner="lab", agent="mine", version=1, kind="remote", track="sensors", benchmark="forecast-hard",
        benchmark_version=VERSION, seeds=[1], slow_policy="wait", act_deadline_s=10.0, ranking=None, withheld=False,
        status="done", failure=None, egos={}, dohyo_versions=["0.2.0"], progress={"total": 4, "done": 4}, created=WHEN,
        started=WHEN, finished=WHEN,
    )  # fmt: skip
    board = {
        "benchmark": "forecast-hard", "version": VERSION, "versions": [VERSION], "metric": "mse",
        "description": HARD.metric, "rows": board_rows([Entry(*run, dohyo_versions=("0.2.0",))], "mse"),
    }  # fmt: skip
    return {
        "benchmarks": [{"name": "forecast-hard", "kind": "forecasting", "description": HARD.description, "egos": []}],
        "leaderboard": board,
        "agents/mine": {"name": "mine", "owner": "lab", "description": "", "created": WHEN.isoformat()},
        "agents/mine/submissions": {"items": [], "next": None},
        "evaluations": {"items": [evaluation.model_dump(mode="json")], "next": None},
        "evaluations/ev-days": evaluation.model_dump(mode="json"),
        "evaluations/ev-days/episodes": {"items": [one.model_dump(mode="json") for one in days], "next": None},
        "evaluations/ev-days/metrics": as_document(Entry(*run)),
        **{f"episodes/{one.id}": one.model_dump(mode="json") for one in days},
    }


@pytest.fixture
def page(visit: Visitor) -> Any:
    """A browser that is told of the days; it must not have complained at the end."""
    one, told = visit(), answers()

    def answer(route: Route) -> None:
        path = route.request.url.partition("/v1/")[2].partition("?")[0]
        if path in told:
            route.fulfill(content_type="application/json", body=json.dumps(told[path], default=str))
        else:
            route.fallback()

    one.page.route("**/v1/**", answer)
    yield one
    assert (one.complaints, one.foreign) == ([], [])


def test_the_board_shows_errors_and_no_infractions(page: Any) -> None:
    shown: BrowserPage = page.go("/?benchmark=forecast-hard")
    heads = " ".join(shown.locator("thead th").all_inner_texts())
    assert "error of three minutes" in heads
    assert "error, t+3 min" in heads
    assert "infractions" not in heads
    expect(shown.locator("tbody tr").first).to_contain_text("18.7")


def test_a_run_lists_its_days_the_largest_error_first_and_each_has_a_page(page: Any) -> None:
    shown: BrowserPage = page.go("/evaluations/ev-days")
    expect(shown.locator("#scores h3")).to_have_count(len(METRICS))
    expect(shown.locator("#scores")).to_contain_text("RMSE, t+3 min km/h")
    rows = shown.locator("#episodes tbody tr")
    expect(rows.locator("th")).to_have_text(["day-0004", "day-0003", "day-0002", "day-0001"])
    expect(rows.nth(1)).to_contain_text("36.0")  # of its squares
    expect(rows.nth(1)).to_contain_text("6.00")  # their root
    expect(rows.first).to_contain_text("—")
    rows.nth(1).get_by_role("link").click()
    expect(shown.locator("h1")).to_have_text("day-0003")
    expect(shown.locator("dl")).to_contain_text("6.00")
    expect(shown.get_by_role("link", name="record", exact=True)).to_have_count(1)
    for width in (1280, 360):
        shown.set_viewport_size({"width": width, "height": 740})
        shown.wait_for_function(f"document.documentElement.scrollWidth <= {width}")
    failed: BrowserPage = page.go("/episodes/ep-4")
    expect(failed.locator(".problem")).to_have_text("NaN")


def test_the_page_of_a_forecaster_shows_errors_and_no_infractions(page: Any) -> None:
    shown: BrowserPage = page.go("/agents/mine")
    expect(shown.locator("h3", has_text="by cell")).to_have_text("Error of three minutes by cell × 10³")
    expect(shown.locator(".cell")).to_contain_text("18.7")
    expect(shown.locator("h3", has_text="Infractions")).to_have_count(0)


def test_a_run_with_a_day_that_failed_keeps_its_measures(page: Any) -> None:
    """The service gives it no score."""

    def without_scores(route: Route) -> None:
        document = json.loads(json.dumps(answers()["evaluations/ev-days/metrics"], default=str))
        document["all"]["scores"] = {}
        route.fulfill(json=document)

    page.page.route("**/v1/evaluations/ev-days/metrics", without_scores)
    shown: BrowserPage = page.go("/evaluations/ev-days")
    expect(shown.locator("#scores h3").first).to_have_text("error of three minutes × 10³")
    expect(shown.locator("#scores")).not_to_contain_text("driving score")
