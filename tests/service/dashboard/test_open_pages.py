"""Pages that stay open while the service restarts, answers late or refuses, and while their reader works in them."""

from __future__ import annotations

import json
import re
from datetime import UTC, datetime, timedelta
from typing import Any

import pytest
from playwright.sync_api import Page, Request, Route, expect

from tests.service.browsing import Visit, Visitor
from tests.service.dashboard.conftest import Site
from tests.service.dashboard.fake import TOKEN, stored

NOTICE = "main [role=alert]:visible"
BEGUN, FAR = datetime(2026, 3, 2, tzinfo=UTC), datetime(2099, 1, 1, tzinfo=UTC)
PAIR = "/compare?evaluation=ev-autopilot&evaluation=ev-reckless"
COLOURS = """canvas => {
  const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
  return new Set(new Uint32Array(data.buffer)).size;
}"""


def phase(state: str, closes: datetime) -> dict[str, Any]:
    return {
        "id": "rk-1", "name": "first", "state": state, "opens": "2026-03-01T00:00:00Z", "closes": closes.isoformat(),
        "ends": "2099-01-01T00:00:00Z", "benchmark": "quickstart", "seeds": [0], "runs_per_period": 9,
        "period_s": 86400, "counts": "best", "track": None, "verified_only": False, "act_deadline_s": 1.0,
        "board": "everybody", "replays": "everybody", "records": "everybody", "board_visible": False,
    }  # fmt: skip


def challenge(page: Page, phase: dict[str, Any], team: str | None = None) -> list[str]:
    """Answers for a challenge of one phase; returns its requests as they come."""
    asked: list[str] = []

    def answer(route: Route) -> None:
        asked.append(route.request.url)
        document = {
            "name": "cup", "title": "Cup", "organiser": "lab", "teams": 1, "my_team": team, "may_organise": False,
            "announcements": [], "rules": "", "phases": [phase],
        }  # fmt: skip
        route.fulfill(json=document)

    page.route("**/v1/challenges/cup", answer)
    return asked


def refusing_once(page: Page, pattern: str) -> list[str]:
    """Answers the first request of a pattern with 502, as a proxy does; returns it once it has come."""
    refused: list[str] = []

    def answer(route: Route) -> None:
        if refused:
            route.continue_()
            return
        refused.append(route.request.url)
        route.fulfill(status=502)

    page.route(pattern, answer)
    return refused


def test_a_progress_that_was_refused_is_listened_to_again(visit: Visitor, site: Site) -> None:
    one = visit()
    refused = refusing_once(one.page, "**/v1/evaluations/ev-live/progress")
    page = one.go("/evaluations/ev-live")
    bar = page.locator("[role=progressbar]")
    assert bar.get_attribute("aria-valuenow") == "4"
    ended = site.fake.queued.pop(0)
    site.fake.events.append({"episode": ended, "status": "done"})
    expect(bar).to_have_attribute("aria-valuenow", "5")
    site.fake.events.append({"episode": site.fake.queued.pop(0), "status": "done"})
    expect(bar).to_have_attribute("aria-valuenow", "6")
    assert refused


def test_an_evaluation_that_ended_while_its_progress_was_refused_is_shown_as_done(visit: Visitor, site: Site) -> None:
    one = visit()
    one.page.route("**/v1/evaluations/ev-live/progress", lambda route: route.fulfill(status=409))
    page = one.go("/evaluations/ev-live")
    expect(page.locator("#tiles")).to_contain_text("running")
    site.fake.queued.clear()
    expect(page.locator("#tiles")).to_contain_text("12 / 12")
    expect(page.locator("#tiles .status")).to_contain_text("done")


def test_an_evaluation_is_read_again_after_a_read_that_failed(visit: Visitor, site: Site) -> None:
    one = visit()
    page = one.go("/evaluations/ev-live")
    failed = refusing_once(page, "**/v1/evaluations/ev-live/episodes*")
    site.fake.queued.clear()
    expect(page.locator("#episodes tbody .status", has_text="queued")).to_have_count(0)
    assert failed


def test_an_evaluation_says_that_its_connection_is_lost_until_it_is_there_again(visit: Visitor, site: Site) -> None:
    one = visit()
    events = "**/v1/evaluations/ev-live/progress"
    one.page.route(events, lambda route: route.abort())
    page = one.go("/evaluations/ev-live")
    expect(page.locator(NOTICE)).to_contain_text("connection to the service is lost, and tried again")
    expect(page.locator(NOTICE)).to_contain_text("may be old")
    page.unroute(events)
    expect(page.locator(NOTICE)).to_have_count(0)
    site.fake.events.append({"episode": site.fake.queued.pop(0), "status": "done"})
    expect(page.locator("[role=progressbar]")).to_have_attribute("aria-valuenow", "5")
    expect(page.locator(NOTICE)).to_have_count(0)


def test_an_evaluation_says_why_it_could_not_be_read_until_it_is_read_again(visit: Visitor, site: Site) -> None:
    page = visit().go("/evaluations/ev-live")
    refused = refusing_once(page, "**/v1/evaluations/ev-live/episodes*")
    site.fake.events.append({"episode": site.fake.queued.pop(0), "status": "done"})
    expect(page.locator(NOTICE)).to_contain_text("The service refused: 502, Bad Gateway.")
    expect(page.locator(NOTICE)).to_have_count(0)
    assert refused


def test_a_secret_run_tells_how_many_episodes_are_done_and_not_which(visit: Visitor) -> None:
    one = visit()
    page = one.page

    def withheld(route: Route) -> None:
        document = route.fetch().json()
        progress = {"total": 12, "done": 5, "running": 2, "queued": 5, "lost": 0, "cancelled": 0}
        route.fulfill(json=document | {"withheld": True, "seeds": None, "progress": progress})

    def queued(route: Route) -> None:
        document = route.fetch().json()
        hidden = {"status": "queued", "scores": None, "seed": None}
        route.fulfill(json=document | {"items": [one | hidden for one in document["items"]]})

    page.route("**/v1/evaluations/ev-live", withheld)
    page.route("**/v1/evaluations/ev-live/episodes*", queued)
    one.go("/evaluations/ev-live")
    expect(page.locator("#tiles")).to_contain_text("5 / 12")
    expect(page.locator("#tiles")).to_contain_text("withheld")
    expect(page.locator("#progress .bar-row")).to_have_count(1)
    expect(page.locator("[role=progressbar]")).to_have_attribute("aria-valuenow", "5")


def test_a_run_without_a_rank_says_why(visit: Visitor) -> None:
    one = visit()

    def unranked(route: Route) -> None:
        document = route.fetch().json()
        document["rows"][-1] |= {"rank": None, "unranked": "lost_too_many", "lost_too_many": True, "lost": 11}
        route.fulfill(json=document)

    one.page.route("**/v1/leaderboard?*", unranked)
    page = one.go("/")
    expect(page.locator(".ranked").last).to_contain_text("no rank: lost more than a tenth of its drives")
    expect(page.locator(".ranked").first).not_to_contain_text("no rank")


def test_a_run_of_another_version_of_dohyo_says_which_drove_it(visit: Visitor) -> None:
    one = visit()

    def upgraded(route: Route) -> None:
        document = route.fetch().json()
        document["rows"][-1] |= {"rank": None, "unranked": "other_version", "dohyo_versions": ["0.1.0"]}
        route.fulfill(json=document)

    one.page.route("**/v1/leaderboard?*", upgraded)
    page = one.go("/")
    expect(page.locator(".ranked").last).to_contain_text("no rank: driven with dohyo 0.1.0")
    expect(page.locator(".note").last).to_contain_text("Ranks compare the runs driven with dohyo 0.2.0")


def test_an_evaluation_says_which_versions_of_dohyo_drove_it(visit: Visitor) -> None:
    one = visit()

    def resumed(route: Route) -> None:
        route.fulfill(json=route.fetch().json() | {"dohyo_versions": ["earlier", "0.2.0"]})

    one.page.route("**/v1/evaluations/ev-autopilot", resumed)
    page = one.go("/evaluations/ev-autopilot")
    expect(page.locator("#tiles")).to_contain_text("driven withan earlier dohyo and dohyo 0.2.0")


def test_a_clock_that_is_fast_does_not_load_the_page_of_a_challenge_again_and_again(visit: Visitor) -> None:
    one = visit()
    page = one.page
    past = phase("open", datetime.now(UTC) - timedelta(seconds=20))
    asked = challenge(page, past)
    one.go("/challenges/cup")
    expect(page.locator(".countdown")).to_have_text("now")
    page.wait_for_timeout(3000)
    assert len(asked) == 1


def test_the_page_of_a_challenge_is_loaded_again_when_its_phase_has_moved_on(visit: Visitor) -> None:
    one = visit()
    page = one.page
    now = phase("open", datetime.now(UTC) + timedelta(seconds=60))
    challenge(page, now)
    page.clock.install()
    one.go("/challenges/cup")
    now["state"] = "closed"
    page.clock.fast_forward(62_000)
    expect(page.locator("h2 .status")).to_contain_text("closed")


def test_the_runs_of_a_team_are_polled_by_one_timer_and_keep_the_focus(visit: Visitor) -> None:
    one = visit()
    page = one.page
    run = {
        "id": "ev-1", "owner": "lab", "agent": "alpha", "version": 1, "benchmark": "quickstart", "ranking": "rk-1",
        "withheld": False, "status": "running", "failure": None, "created": "2026-03-01T14:05:00Z",
        "progress": {"total": 12, "done": 1, "running": 1, "lost": 0},
    }  # fmt: skip
    polls: list[Request] = []

    def runs(route: Route) -> None:
        if route.request.method == "POST":
            route.fulfill(json=run)
            return
        polls.extend([route.request] if "ranking=" in route.request.url else [])
        route.fulfill(json={"items": [run], "next": None})

    challenge(page, phase("open", FAR), team="lab")
    page.route("**/v1/me", lambda route: route.fulfill(json={"owner": "lab", "role": "submitter", "token": "tok-1"}))
    page.route("**/v1/challenges/cup/teams", lambda route: route.fulfill(json=[{"name": "lab", "members": ["lab"]}]))
    agents = {"items": [{"name": "alpha", "owner": "lab", "version": 1, "kind": "builtin"}], "next": None}
    page.route("**/v1/agents?*", lambda route: route.fulfill(json=agents))
    page.route("**/v1/evaluations**", runs)
    page.clock.install(time=BEGUN)
    one.go("/challenges/cup")
    page.clock.pause_at(BEGUN + timedelta(hours=1))  # a busy machine is slow, and the clock of the page must not go on
    for _ in range(3):
        page.get_by_role("button", name="start the run", exact=True).click()
        expect(page.get_by_role("button", name="start the run", exact=True)).to_be_enabled()
    before = len(polls)
    with page.expect_request("**/v1/evaluations?ranking=*"):
        page.clock.run_for(4500)
    page.wait_for_timeout(500)
    assert len(polls) == before + 1
    page.clock.run_for(300)
    page.get_by_role("button", name="cancel", exact=True).click()
    run["progress"] = {"total": 12, "done": 2, "running": 1, "lost": 0}
    page.clock.run_for(3800)
    expect(page.locator("#runs")).to_contain_text("2 / 12")
    assert page.evaluate("document.activeElement.textContent") == "really cancel"


def test_the_replays_of_the_last_press_stay_and_keys_reach_no_others(visit: Visitor) -> None:
    one = visit()
    page = one.go(PAIR)
    late: list[Route] = []

    def hold_first(route: Route) -> None:
        if late:
            route.continue_()
        else:
            late.append(route)

    page.route("**/v1/episodes/*/replay", hold_first)
    buttons = page.get_by_role("button", name="side by side")
    buttons.nth(0).click()
    expect(page.locator("#lockstep h2")).to_be_visible()
    buttons.nth(1).click()
    expect(page.locator("#lockstep canvas")).to_have_count(2)
    heading = page.locator("#lockstep h2").inner_text()
    page.locator("#lockstep .theatre").evaluate("element => (element.dataset.kept = 'yes')")
    late[0].continue_()
    page.wait_for_timeout(1000)
    assert page.locator("#lockstep h2").inner_text() == heading
    assert page.locator("#lockstep .theatre").get_attribute("data-kept") == "yes"
    page.evaluate("window.before = document.querySelector('#lockstep .controls .clock')")
    buttons.nth(0).click()
    expect(page.locator("#lockstep .clock")).not_to_be_empty()
    shown = page.evaluate("before.textContent")
    page.locator("#lockstep canvas").first.focus()
    page.keyboard.press("ArrowRight")
    expect(page.locator("#lockstep .clock")).to_contain_text("0.1 /")
    assert page.evaluate("before.textContent") == shown
    assert one.complaints == []


def test_replays_that_may_not_be_read_are_said(visit: Visitor) -> None:
    page = visit().go(PAIR)
    problem = {"title": "Forbidden", "detail": "the replays of this phase are secret"}
    page.route("**/v1/episodes/*/replay", lambda route: route.fulfill(status=403, json=problem))
    page.get_by_role("button", name="side by side").first.click()
    expect(page.locator("#lockstep [role=alert]")).to_contain_text("the replays of this phase are secret")
    assert "Reading both" not in page.locator("#lockstep").inner_text()


def test_two_versions_of_one_agent_are_told_apart(visit: Visitor) -> None:
    page = visit().go("/compare?evaluation=ev-reckless&evaluation=ev-reckless@2")
    expect(page.locator("h1")).to_have_text("reckless v1 and reckless v2")
    expect(page.locator("h3").first).to_have_text("reckless v1 minus reckless v2")


def test_versions_have_columns_of_their_own_in_the_csv_of_scenarios(visit: Visitor) -> None:
    def same_agent(route: Route) -> None:
        document = route.fetch().json()
        for version, side in enumerate(document["evaluations"], 1):
            side.update(agent="alpha", version=version)
        route.fulfill(json=document)

    one = visit(permissions=["clipboard-read", "clipboard-write"])
    one.page.route("**/v1/comparison?*", same_agent)
    page = one.go(PAIR)
    section = page.locator("section", has=page.locator("h2", has_text="Where they differ most"))
    section.get_by_role("button", name="copy as CSV").click()
    section.get_by_role("button", name="copied").wait_for()
    head = page.evaluate("navigator.clipboard.readText()").splitlines()[0].split(",")
    assert head == ["scenario", "seed", "alpha v1", "alpha v2", "spread"]


def test_an_evaluation_that_is_opened_early_gets_its_filter_of_endings(visit: Visitor, site: Site) -> None:
    site.fake.queued = [name for name in site.fake.records if name.startswith("autopilot")]
    one = visit()
    one.page.route("**/v1/evaluations/ev-live/episodes*", queue_all)
    page = one.go("/evaluations/ev-live")
    expect(page.locator("#episodes tbody tr")).to_have_count(12)
    assert page.get_by_label("ending", exact=True).count() == 0
    page.get_by_label("search").focus()
    page.unroute("**/v1/evaluations/ev-live/episodes*")
    ended = site.fake.queued.pop(0)
    site.fake.events.append({"episode": ended, "status": "done"})
    expect(page.get_by_label("ending", exact=True)).to_be_visible()
    assert page.evaluate("document.activeElement.type") == "search"


def queue_all(route: Route) -> None:
    """Answers as if no episode had begun."""
    document = route.fetch().json()
    for one in document["items"]:
        one["status"] = "queued"
    route.fulfill(json=document)


def test_a_table_that_was_made_anew_leaves_nothing_of_the_one_before(visit: Visitor, site: Site) -> None:
    site.fake.queued = [name for name in site.fake.records if name.startswith("autopilot")]
    one = visit()
    one.page.route("**/v1/evaluations/ev-live/episodes*", queue_all)
    page = one.go("/evaluations/ev-live")
    page.evaluate("window.before = new WeakRef(document.querySelector('#episodes table'))")
    page.unroute("**/v1/evaluations/ev-live/episodes*")
    site.fake.events.append({"episode": site.fake.queued.pop(0), "status": "done"})
    expect(page.get_by_label("ending", exact=True)).to_be_visible()
    assert is_forgotten(page)


def test_a_map_that_was_drawn_anew_leaves_nothing_of_the_one_before(visit: Visitor) -> None:
    one = visit()
    one.page.route("**/infractions", two_networks)
    page = one.go("/evaluations/ev-reckless/map")
    page.evaluate("window.before = new WeakRef(document.querySelector('canvas'))")
    page.get_by_label("network").select_option("b-town")
    expect(page.locator("canvas")).to_have_attribute("aria-label", re.compile("Map of b-town"))
    assert is_forgotten(page)
    rows = page.locator("tbody tr:visible")
    expect(rows).to_have_count(17)
    page.set_viewport_size({"width": 360, "height": 740})
    expect(rows).to_have_count(12)  # the table still follows the window


def is_forgotten(page: Page) -> bool:
    """Whether nothing on the page holds what `window.before` refers to, once all has come that is under way."""
    collector = page.context.new_cdp_session(page)
    for _ in range(60):
        page.wait_for_timeout(500)
        collector.send("HeapProfiler.collectGarbage")
        if page.evaluate("before.deref() === undefined"):
            return True
    return False


def test_another_ego_of_the_address_changes_facts_and_timeline_and_the_choice_keeps_the_focus(visit: Visitor) -> None:
    replay = json.loads(json.dumps(stored("replay-reckless")))
    [ego] = replay["egos"]
    replay["egos"].append(ego | {"name": "second", "infractions": []})
    [track] = [one for one in replay["actors"] if one["kind"] == "ego"]
    replay["actors"].append(track | {"name": "second"})
    one = visit()
    one.page.route("**/v1/episodes/*/replay", lambda route: route.fulfill(json=replay))
    page = one.go("/episodes/reckless-right-to-south-s0")
    expect(page.locator(".facts-panel")).to_contain_text("Infractions (")
    page.evaluate("location.hash = 't=1&ego=second'")
    expect(page.locator(".facts-panel")).to_contain_text("No infraction")
    expect(page.locator(".timeline .moment")).to_have_count(0)
    select = page.locator(".facts-panel select")
    expect(select).to_have_value("second")
    select.focus()
    page.keyboard.press("ArrowUp")
    expect(page.locator(".facts-panel")).to_contain_text("Infractions (")
    assert page.evaluate("document.activeElement.localName") == "select"
    assert one.complaints == []


REFUSED = {"title": "Too many requests", "detail": "wait 9 s"}


def test_reasons_that_failed_are_not_asked_for_again_until_the_next_jump(visit: Visitor) -> None:
    page = visit().go("/episodes/reckless-right-to-south-s0#t=2")
    page.get_by_role("button", name="show the agent's reasons").click()
    expect(page.locator(".reasons")).to_contain_text("free road")
    asked: list[str] = []

    held: list[Route] = []

    def refuse(route: Route) -> None:
        asked.append(route.request.url)
        if held:
            route.fulfill(status=429, json=REFUSED)
        else:
            held.append(route)

    page.route("**/explanation?*", refuse)
    with page.expect_request("**/explanation?*"):
        page.keyboard.press("ArrowRight")
    page.wait_for_timeout(1000)  # a slow answer is waited for
    assert len(asked) == 1
    held[0].fulfill(status=429, json=REFUSED)
    expect(page.locator(".reasons")).to_contain_text("wait 9 s")
    page.wait_for_timeout(1000)
    assert len(asked) == 1
    with page.expect_request("**/explanation?*"):
        page.keyboard.press("ArrowRight")
    expect(page.locator(".clock")).to_contain_text("2.2 /")
    assert len(asked) == 2


def two_networks(route: Route) -> None:
    """Answers as if every second infraction were in another town."""
    document = route.fetch().json()
    for i, each in enumerate(document["infractions"]):
        each["network"] = ("a-town", "b-town")[i % 2]
    route.fulfill(json=document)


def test_the_map_shows_the_network_that_was_chosen_last(visit: Visitor) -> None:
    one = visit()
    late: list[Route] = []
    one.page.route("**/infractions", two_networks)
    page = one.go("/evaluations/ev-reckless/map")
    page.route("**/v1/networks/b-town/map?*", lambda route: late.append(route))
    with page.expect_request("**/v1/networks/b-town/map?*"):
        page.get_by_label("network").select_option("b-town")
    page.get_by_label("network").select_option("a-town")
    page.wait_for_timeout(500)
    late[0].continue_()
    page.wait_for_timeout(500)
    assert "Map of a-town" in str(page.locator("canvas").get_attribute("aria-label"))


def live_world(one: Visit) -> Page:
    """Opens the page of a live world, signed in; its first ego has ended."""
    page = one.page
    replay = stored("replay-reckless")
    route = replay["egos"][0]["route"]
    names = ["west", "east"]
    seats = [{"name": name, "driving": name == "east", "driver": None} for name in names]
    world = {
        "id": "wo-1", "status": "paused", "network": "ingolstadt", "scenario": "meeting", "seed": 0, "finished": None,
        "created": "2026-03-01T14:05:00Z", "egos": seats, "record_hash": None,
    }  # fmt: skip
    stage = {
        "dt_s": 0.1, "bounds": replay["bounds"], "signals": [],
        "egos": [{"name": name, "length": 4.6, "width": 1.8, "route": route} for name in names],
    }  # fmt: skip
    pose = [*route[5][:2], 0.0, 3.0]
    scene = {"tick": 9, "time_s": 0.9, "egos": [[0, 0, 0, 0, False], [*pose, True]], "actors": [], "lights": ""}
    said = "".join(
        f"event: {name}\ndata: {json.dumps(data)}\n\n" for name, data in (("stage", stage), ("scene", scene))
    )
    page.route("**/v1/worlds/wo-1", lambda route: route.fulfill(json=world))
    page.route("**/v1/worlds/wo-1/events", lambda route: route.fulfill(body=said, content_type="text/event-stream"))
    page.route("**/v1/me", lambda route: route.fulfill(json={"owner": "lab", "role": "submitter", "token": "tok-1"}))
    one.go("/login?next=/evaluations").get_by_label("Token").fill(TOKEN)
    page.keyboard.press("Enter")
    page.wait_for_url("**/evaluations")
    page.wait_for_selector("main[data-state=ready]")
    return one.go("/worlds/wo-1")


def test_a_live_world_whose_first_ego_has_ended_is_drawn_and_the_choice_keeps_the_focus(visit: Visitor) -> None:
    one = visit()
    page = live_world(one)
    page.wait_for_selector("canvas")
    expect(page.locator(".facts-panel .command")).to_contain_text("wo-1 east-driver east 8.0")
    page.wait_for_function(f"({COLOURS})(document.querySelector('canvas')) > 3")
    button = page.get_by_role("button", name="east")
    button.focus()
    page.keyboard.press("Space")
    expect(button).to_have_attribute("aria-pressed", "true")
    assert "east" in page.evaluate("document.activeElement.textContent")
    assert one.complaints == []


def test_a_world_whose_connection_is_lost_says_so(visit: Visitor) -> None:
    """The stream of the fake world ends, and the next one is refused by the network."""
    one = visit()
    page = live_world(one)
    page.wait_for_selector("canvas")
    page.route("**/v1/worlds/wo-1/events", lambda route: route.abort())
    expect(page.locator(NOTICE)).to_contain_text("connection to the service is lost, and tried again")
    page.wait_for_timeout(4000)  # the browser tries again after three seconds
    expect(page.locator(NOTICE)).to_be_visible()


@pytest.mark.parametrize(
    ("seconds", "text"), [(7199, "2 h 0 min"), (3600, "1 h 0 min"), (5400, "1 h 30 min"), (200, "3 min 20 s")]
)
def test_a_span_never_has_sixty_minutes(visit: Visitor, seconds: float, text: str) -> None:
    page = visit().go("/login")
    found = page.evaluate("async s => (await import('/static/format.js')).span(s)", seconds)
    assert found == text
