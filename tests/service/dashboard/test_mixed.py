"""Mixed runs in a real browser: the page of a run by agent, and the cross-play of a board."""

from __future__ import annotations

import json
from typing import Any

import pytest
from playwright.sync_api import Page as BrowserPage
from playwright.sync_api import Route, expect

from dohyo.service.boards.leaderboard import Driver, Entry
from dohyo.service.episodes.views import EpisodeView
from dohyo.service.evaluations.metrics import as_document
from dohyo.service.evaluations.scoring import summary_of
from dohyo.service.evaluations.views import EvaluationView
from dohyo.service.mixed_runs.cross_play import CrossPlays, meetings_of
from tests.evaluation.builders import ego, episode
from tests.service.dashboard.conftest import Visitor
from tests.service.dashboard.fake import BENCHMARKS, VERSION, WHEN
from tests.service.evaluations.test_scoring import drives_of

RECORD = episode(ego(name="west", progress_m=900.0), ego(name="east", progress_m=300.0), name="junction", cell="town")
OTHER = {"agent": "idm", "version": 2, "submission": "su-idm", "kind": "builtin", "track": "map"}


def entry() -> Entry:
    return Entry(
        "ev-mixed", "su-autopilot", "autopilot", 1, "lab", "builtin", "privileged", "fleet", VERSION, (0,), WHEN,
        tuple(drives_of(RECORD)), others={"east": Driver("su-idm", "idm", 2, "lab", "builtin", "map")},
    )  # fmt: skip


def answers() -> dict[str, Any]:
    """Answers of a service with one mixed run, by the end of their paths."""
    evaluation = EvaluationView(
        id="ev-mixed", owner="lab", agent="autopilot", version=1, kind="builtin", track="privileged", benchmark="fleet",
        egos={"east": OTHER}, benchmark_version=VERSION, seeds=[0], slow_policy="wait", act_deadline_s=10.0,
        ranking=None, withheld=False, dohyo_versions=["0.2.0"], status="done", failure=None,
        progress={"total": 1, "done": 1}, created=WHEN, started=WHEN, finished=WHEN,
    )  # fmt: skip
    driven = EpisodeView(
        id="ep-1", evaluation="ev-mixed", position=0, scenario="junction", cell="town", seed=0, status="done",
        attempts=1, record_hash="0" * 64, summary=summary_of(RECORD, "2.0"), failure=None, started=WHEN, finished=WHEN,
    )  # fmt: skip
    fleet = BENCHMARKS[0].model_copy(update={"name": "fleet", "egos": ["west", "east"]})
    of_fleet = {"benchmark": "fleet", "version": VERSION, "versions": [VERSION], "metric": "driving_score", "runs": 1}
    met = CrossPlays().matrix({"ev-mixed": meetings_of(entry(), "driving_score")}, {}, "driving_score")
    return {
        "benchmarks": [fleet.model_dump(mode="json")],
        "benchmarks/fleet/cross-play": of_fleet | {"description": ""} | met,
        "evaluations/ev-mixed": evaluation.model_dump(mode="json"),
        "evaluations/ev-mixed/episodes": {"items": [driven.model_dump(mode="json")], "next": None},
        "evaluations/ev-mixed/metrics": as_document(entry()),
        "evaluations": {"items": [evaluation.model_dump(mode="json")], "next": None},
    }


@pytest.fixture
def page(visit: Visitor) -> Any:
    """A browser that is told of the run; it must not have complained at the end."""
    one, told = visit(), answers()

    def answer(route: Route) -> None:
        path = route.request.url.partition("/v1/")[2].partition("?")[0]
        if path in told:
            route.fulfill(content_type="application/json", body=json.dumps(told[path]))
        else:
            route.fallback()

    one.page.route("**/v1/**", answer)
    yield one
    assert (one.complaints, one.foreign) == ([], [])


def texts(shown: BrowserPage, rows: str) -> list[str]:
    return [" ".join(text.split()) for text in shown.locator(rows).all_inner_texts()]


def test_a_mixed_run_is_shown_by_agent_and_not_compared(page: Any) -> None:
    shown: BrowserPage = page.go("/evaluations/ev-mixed")
    expect(shown.locator("h1")).to_have_text("autopilot and idm on fleet")
    expect(shown.locator("#scores h2")).to_have_text("Scores by agent")
    first, second, met = texts(shown, "#scores tbody tr")
    assert first.startswith("autopilot v1 west 90.0 n=1")
    assert second.startswith("idm v2 east 30.0 n=1")
    assert met == "autopilot v1 idm v2 1 0"
    (row,) = texts(shown, "#episodes tbody tr")
    assert "idm east" in row
    page.go("/evaluations")
    expect(shown.get_by_role("checkbox")).to_be_disabled()


def test_a_board_has_the_matrix_of_the_agents_that_met(page: Any) -> None:
    shown: BrowserPage = page.go("/?benchmark=fleet")
    for width in (1280, 360):
        shown.set_viewport_size({"width": width, "height": 740})
        shown.wait_for_function(f"document.documentElement.scrollWidth <= {width}")
    shown.set_viewport_size({"width": 1280, "height": 740})
    rows = texts(shown, ".cross-play tbody tr")
    assert [row.split()[0] for row in rows] == ["autopilot", "idm"]
    assert rows[0].endswith("no run alone 90.0 n=1")
    assert rows[1].endswith("30.0 n=1 no run alone")
