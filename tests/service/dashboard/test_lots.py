"""Parking lots in a real browser: the lots of a run, and the replay of one, by the keyboard."""

from __future__ import annotations

import json
from functools import cache
from typing import Any

import pytest
from playwright.sync_api import Page as BrowserPage
from playwright.sync_api import Route, expect

from dohyo.evaluation.parking.agent import make_parking_agent
from dohyo.evaluation.parking.benchmark import LOT, load_parking_benchmark
from dohyo.evaluation.parking.drive import Drive, drive_lots
from dohyo.evaluation.records.record import AgentInfo
from dohyo.service.boards.leaderboard import Entry
from dohyo.service.episodes.reading_views import EpisodeDetail
from dohyo.service.evaluations import scoring
from dohyo.service.evaluations.metrics import as_document
from dohyo.service.evaluations.views import EvaluationView
from dohyo.service.parking.replay import replay_of_lot
from tests.service.browsing import drawn
from tests.service.dashboard.conftest import Visitor
from tests.service.dashboard.fake import VERSION, WHEN

GREEDY = "tests.evaluation.parking.parkers:Greedy"


@cache
def drives() -> tuple[Drive, ...]:
    """Of three blind karts among pedestrians: some park, some touch."""
    benchmark = load_parking_benchmark("parking-three").model_copy(update={"scene": "pedestrians"})
    info = AgentInfo(name="greedy", entry=GREEDY, track="sensors", sensors=(), control="torque_steering_brake")
    return tuple(drive_lots(benchmark, range(6), [make_parking_agent(GREEDY) for _ in range(3)], info))


def detail(number: int) -> EpisodeDetail:
    record = drives()[number].record
    return EpisodeDetail(
        id=f"ep-{number}", evaluation="ev-lots", position=number, scenario=LOT, cell=LOT, seed=record.seed, attempts=1,
        failure=None, started=WHEN, finished=WHEN, status="done", record_hash=record.record_hash,
        summary=scoring.summary_of_lot(record), agent="greedy", agent_version=1, egos={},
        benchmark="parking-three", benchmark_version=VERSION, rules=None, network=None,
    )  # fmt: skip


def answers() -> dict[str, Any]:
    """Answers of a service with one run, by the end of their paths."""
    details = [detail(number) for number in range(len(drives()))]
    found = tuple(
        scoring.Drive(one.id, LOT, LOT, int(one.seed or 0), facts)
        for one in details
        for facts in (one.summary or {})["egos"]
    )
    run = ("ev-lots", "su-1", "greedy", 1, "lab", "remote", "sensors", "parking-three", VERSION, (0, 1), WHEN, found)
    evaluation = EvaluationView(
        id="ev-lots", owner="lab", agent="greedy", version=1, kind="remote", track="sensors", benchmark="parking-three",
        benchmark_version=VERSION, seeds=[0, 1], slow_policy="wait", act_deadline_s=10.0, ranking=None, withheld=False,
        status="done", failure=None, egos={}, dohyo_versions=["0.2.0"], progress={"total": 6, "done": 6}, created=WHEN,
        started=WHEN, finished=WHEN,
    )  # fmt: skip
    told = {
        "evaluations/ev-lots": evaluation.model_dump(mode="json"),
        "evaluations/ev-lots/episodes": {"items": [one.model_dump(mode="json") for one in details], "next": None},
        "evaluations/ev-lots/metrics": as_document(Entry(*run)),
    }
    for number, one in enumerate(details):
        drive = drives()[number]
        told[f"episodes/{one.id}"] = one.model_dump(mode="json")
        told[f"episodes/{one.id}/replay"] = replay_of_lot(drive.record, drive.motion, episode=one.id)
    return told


@pytest.fixture
def page(visit: Visitor, request: pytest.FixtureRequest) -> Any:
    """A browser that is told of the lots; it must not have complained at the end."""
    one, told = visit(**getattr(request, "param", {})), answers()

    def answer(route: Route) -> None:
        path = route.request.url.partition("/v1/")[2].partition("?")[0]
        if path in told:
            route.fulfill(content_type="application/json", body=json.dumps(told[path]))
        else:
            route.fallback()

    one.page.route("**/v1/**", answer)
    yield one
    assert (one.complaints, one.foreign) == ([], [])


def touched() -> int:
    """A lot in which the first kart touches something."""
    return next(n for n, drive in enumerate(drives()) if drive.record.karts[0].touched != "nothing")


def test_a_run_lists_its_lots_the_least_parked_first(page: Any) -> None:
    shown: BrowserPage = page.go("/evaluations/ev-lots")
    expect(shown.locator("#scores h3")).to_have_text(
        ["success %", "aligned, of successes %", "time to park s", "contacts %"]
    )
    rows = shown.locator("#episodes tbody tr")
    expect(rows).to_have_count(6)
    parked = [
        int(text.split("/")[0]) for text in shown.locator("#episodes td[data-label='parked karts']").all_inner_texts()
    ]
    assert parked == sorted(parked)
    assert sum(parked) == sum(kart.parked for drive in drives() for kart in drive.record.karts)
    expect(shown.get_by_role("link", name="map of infractions")).to_have_count(0)
    rows.first.get_by_role("link").click()
    expect(shown.locator("h1")).to_have_text("lot " + rows_seed(parked))


def rows_seed(parked: list[int]) -> str:
    """Seed of the first lot of those in which the fewest karts parked."""
    counts = [sum(kart.parked for kart in drive.record.karts) for drive in drives()]
    return str(drives()[counts.index(parked[0])].record.seed)


@pytest.mark.parametrize("page", [{}, {"width": 360, "color_scheme": "dark"}], indirect=True, ids=["wide", "narrow"])
def test_a_lot_is_replayed_by_the_keyboard(page: Any) -> None:
    number = touched()
    record = drives()[number].record
    shown: BrowserPage = page.go(f"/episodes/ep-{number}")
    expect(shown.locator("h1")).to_have_text(f"lot {record.seed}")
    before = picture(shown)
    shown.keyboard.press("i")
    expect(shown.locator(".clock")).to_contain_text(f"{record.karts[0].time_s:.1f} /")
    assert picture(shown) != before
    expect(shown.locator(".controls [role=status]")).to_contain_text("hit at")
    shown.keyboard.press("ArrowLeft")
    expect(shown.locator(".clock")).to_contain_text(f"{record.karts[0].time_s - 0.1:.1f} /")
    slider = shown.get_by_role("slider", name="time, s")
    slider.focus()
    shown.keyboard.press("Home")
    expect(shown.locator(".clock")).to_contain_text("0.0 /")
    expect(shown.locator(".facts-panel")).to_contain_text(f"touched{record.karts[0].touched}")
    shown.get_by_label("kart").select_option("kart-2")
    expect(shown.locator(".facts-panel")).to_contain_text(f"touched{record.karts[2].touched}")
    width = shown.evaluate("document.documentElement.scrollWidth")
    assert width <= shown.viewport_size["width"]  # type: ignore[index]


def picture(page: BrowserPage) -> str:
    """Pixels of the replay."""
    drawn(page)
    return str(page.evaluate("document.querySelector('canvas').toDataURL()"))
