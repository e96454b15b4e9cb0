"""Every page in a real browser: drawn, silent, offline, narrow, light and dark, by keyboard, live."""

from __future__ import annotations

import itertools

import pytest
from playwright.sync_api import expect

from dohyo.evaluation.records.specifications import Status
from dohyo.service.episodes.views import AttemptView
from dohyo.service.evaluations.model import AttemptOutcome
from tests.service.browsing import drawn
from tests.service.dashboard import fake as fakes
from tests.service.dashboard.conftest import Site, Visitor

PAGES = {
    "leaderboard": "/",
    "evaluations": "/evaluations",
    "evaluation": "/evaluations/ev-reckless",
    "live": "/evaluations/ev-live",
    "agent": "/agents/reckless",
    "compare": "/compare?evaluation=ev-autopilot&evaluation=ev-reckless&scenario=right-to-south-s0",
    "map": "/evaluations/ev-reckless/map",
    "episode": "/episodes/reckless-right-to-south-s0#t=14",
    "waiting": "/episodes/waiting",
    "league": "/league",
    "api": "/api",
    "login": "/login",
    "join": "/join",
}


@pytest.mark.parametrize("path", PAGES.values(), ids=PAGES)
def test_every_page_is_drawn_silently_and_without_other_hosts_at_any_width(visit: Visitor, path: str) -> None:
    one = visit()
    page = one.go(path)
    assert page.locator("main").get_attribute("data-state") == "ready"
    assert page.locator("h1").count() == 1
    for width in (1280, 1024, 760, 360):
        page.set_viewport_size({"width": width, "height": 740})
        page.wait_for_function(f"document.documentElement.scrollWidth <= {width}")
    assert one.complaints == []
    assert one.foreign == []


def test_the_leaderboard_shows_mean_interval_and_n_best_first(visit: Visitor) -> None:
    page = visit().go("/")
    rows = page.locator("tbody tr")
    assert [rows.nth(i).locator("th a").inner_text() for i in range(2)] == ["autopilot", "reckless"]
    score = rows.nth(0).locator("td.estimate").first
    expect(score).to_contain_text("n=12")
    assert score.locator("circle").count() == 1
    expect(rows.nth(1).locator(".verdict")).to_have_text("< P(A better) < 0.001")


def test_the_leaderboard_of_another_track_and_benchmark_is_chosen_by_the_address(visit: Visitor) -> None:
    page = visit().go("/?track=map")
    assert page.locator("tbody tr").count() == 1
    with page.expect_navigation():
        page.select_option("select[name=track]", "sensors")
    page.wait_for_selector(".state")
    assert "track=sensors" in page.url


def test_the_league_shows_who_leads_each_discipline_and_what_the_sources_say(visit: Visitor) -> None:
    page = visit().go("/league")
    expect(page.locator("h1 + p")).to_contain_text("driven with dohyo ")
    excerpts = page.locator("tr", has_text="Excerpts of recorded traffic").first
    expect(excerpts).to_contain_text("pdm-closed, pdm-hybrid")  # which drives as the other one: both are first
    parking = page.locator("section#parking")
    assert [row.split("\n")[0] for row in parking.locator("tbody th").all_inner_texts()][:1] == ["parking-expert"]
    expect(parking.locator("tbody tr").first.locator("th b")).to_have_text("parking-expert")
    expect(parking).to_contain_text("92 %, Unity")
    three = page.locator("section#parking-three tbody tr").last
    assert three.locator("th b").count() == 0  # significantly behind


def test_the_league_warns_of_few_drives_and_gives_a_reason_for_each_missing_number(visit: Visitor) -> None:
    page = visit().go("/league")
    expect(page.locator("main")).to_contain_text("With few drives this includes entrants that drive clearly worse")
    assert page.locator("section[id] tbody td:empty").count() == 0
    reasons = page.locator("section[id] tbody .missing").evaluate_all("found => found.map((one) => one.title)")
    assert {"its source reports no such number", "not measured in this discipline"} <= set(reasons)


def test_an_empty_leaderboard_says_the_command_that_fills_it(visit: Visitor, site: Site) -> None:
    site.fake.empty = True
    page = visit().go("/")
    expect(page.locator(".state .command")).to_contain_text("/v1/evaluations")


def test_a_missing_episode_says_so_within_the_page(visit: Visitor) -> None:
    page = visit().go("/episodes/nope")
    assert page.locator("main").get_attribute("data-state") == "failed"
    expect(page.locator("[role=alert]")).to_contain_text("no episode 'nope'")


def test_evaluations_that_cannot_be_compared_are_explained(visit: Visitor) -> None:
    page = visit().go("/compare?evaluation=ev-autopilot&evaluation=ev-other")
    expect(page.locator("[role=alert]")).to_contain_text("one benchmark version")


def test_two_finished_evaluations_are_chosen_to_be_compared(visit: Visitor) -> None:
    page = visit().go("/evaluations")
    button = page.get_by_role("button", name="compare", exact=True)
    assert button.is_disabled()
    boxes = page.locator("input[type=checkbox]:enabled")
    boxes.nth(0).check()
    boxes.nth(1).check()
    button.click()
    page.wait_for_url("**/compare?*")
    page.wait_for_selector("main[data-state=ready]")
    expect(page.locator("h2").first).to_have_text("Scores")


def test_a_copied_table_is_csv_with_every_interval(visit: Visitor) -> None:
    one = visit(permissions=["clipboard-read", "clipboard-write"])
    page = one.go("/")
    page.get_by_role("button", name="copy as CSV").click()
    page.get_by_role("button", name="copied").wait_for()
    lines = page.evaluate("navigator.clipboard.readText()").splitlines()
    head, first = (line.split(",") for line in lines[:2])
    assert len(lines) == 3
    row = dict(zip(head, first, strict=True))
    assert (row["agent"], row["driving_score_n"]) == ("autopilot", "12")
    assert float(row["driving_score_low"]) < float(row["driving_score"]) < float(row["driving_score_high"])


def test_an_evaluation_lists_its_worst_episode_first_with_marks_that_open_the_replay(visit: Visitor) -> None:
    page = visit().go("/evaluations/ev-reckless")
    rows = page.locator("#episodes tbody tr")
    scores = [float(rows.nth(i).locator("td").nth(2).inner_text()) for i in range(rows.count())]
    assert scores == sorted(scores)
    expect(rows.first.locator("th")).to_have_text("right-to-south")
    marks = rows.first.locator(".route a")
    assert marks.count() == 5
    assert marks.first.get_attribute("href") == "/episodes/reckless-right-to-south-s0#t=12.6"


def test_an_evaluation_lists_the_attempts_that_failed_with_their_reasons(visit: Visitor, site: Site) -> None:
    page = visit().go("/evaluations/ev-autopilot")
    expect(page.locator("#attempts")).to_be_empty()
    gone = AttemptView(
        number=1, started=fakes.WHEN, ended=fakes.WHEN, outcome=AttemptOutcome.WORKER_GONE,
        why="the worker fell silent", charged=True, processor_s=1.5,
    )  # fmt: skip
    done = gone.model_copy(update={"number": 2, "outcome": AttemptOutcome.DONE, "why": None, "charged": False})
    site.fake.attempts = {site.fake.queued[0]: [gone, done]}
    page.reload()
    rows = page.locator("#attempts tbody tr")
    expect(rows).to_have_count(1)
    expect(rows).to_contain_text("worker gone")
    expect(rows).to_contain_text("the worker fell silent")


def test_an_evaluation_that_lost_drives_also_shows_the_means_that_count_them_as_0(visit: Visitor, site: Site) -> None:
    page = visit().go("/evaluations/ev-autopilot")
    assert page.locator("#scores .measure").count() == 4
    site.fake.lost = {"all": 12}
    page.reload()
    page.wait_for_selector("main[data-state=ready]")
    score = page.locator("#scores .measures > div").first
    expect(score.locator("p")).to_have_text("counting 12 lost drives as 0")
    without, as_zero = (float(text) for text in score.locator(".measure b").all_inner_texts())
    assert as_zero == pytest.approx(without / 2, rel=0.01)
    expect(score.locator(".measure").last).to_contain_text("n=24")


def gridlock(site: Site, name: str) -> None:
    """The traffic was gridlocked in an episode."""
    record = site.fake.records[name]
    (ego,) = record.egos
    changed = record.model_copy(update={"egos": (ego.model_copy(update={"status": Status.GRIDLOCK}),)})
    site.fake.records[name] = changed


def test_a_gridlocked_drive_is_shown_as_lost_beside_the_scores(visit: Visitor, site: Site) -> None:
    gridlock(site, "reckless-right-to-south-s0")
    page = visit().go("/evaluations/ev-reckless")
    expect(page.locator("#tiles")).to_contain_text("12 / 12")
    expect(page.locator("#tiles div").filter(has_text="lost").locator("dd")).to_have_text("1")
    bar = page.locator("[role=progressbar]")
    assert (bar.get_attribute("aria-valuenow"), bar.get_attribute("aria-valuemax")) == ("12", "12")
    expect(page.locator("#scores .measures > div").first.locator("p")).to_have_text("counting 1 lost drive as 0")
    row = page.locator("#episodes tbody tr").last  # it was the worst
    expect(row.locator("th")).to_have_text("right-to-south")
    expect(row).to_contain_text("traffic was gridlocked")
    expect(row.locator("td").nth(2)).to_have_text("—")


def test_the_board_and_the_comparison_show_lost_drives_and_pair_the_others(visit: Visitor, site: Site) -> None:
    one = visit()
    assert "lost" not in one.go("/").locator("thead").inner_text()
    gridlock(site, "reckless-right-to-south-s0")
    page = one.go("/")
    rows = page.locator("tbody tr")
    lost = page.locator("td[data-label='lost drives']")
    assert lost.all_inner_texts() == ["0", "1"]
    expect(rows.nth(1).locator("td.estimate").first).to_contain_text("n=11")
    page = one.go("/compare?evaluation=ev-autopilot&evaluation=ev-reckless")
    assert page.locator("td[data-label='lost drives']").all_inner_texts() == ["0", "1"]
    mission = page.locator("#matrix tbody tr").filter(has_text="right-to-south").locator("td")
    expect(mission.nth(1)).to_contain_text("n=1")


def test_the_page_of_a_gridlocked_episode_says_that_it_counts_in_no_score(visit: Visitor, site: Site) -> None:
    page = visit().go("/episodes/reckless-right-to-south-s0")
    assert page.locator(".facts-panel .reason").count() == 0
    replay = fakes.stored("replay-reckless")
    status, replay["egos"][0]["status"] = replay["egos"][0]["status"], Status.GRIDLOCK.value
    try:
        page.reload()
        expect(page.locator(".facts-panel .reason")).to_contain_text("counts in no score")
    finally:
        replay["egos"][0]["status"] = status


def test_a_running_evaluation_moves_its_bar_as_episodes_end(visit: Visitor, site: Site) -> None:
    page = visit().go("/evaluations/ev-live")
    bar = page.locator("[role=progressbar]")
    assert (bar.get_attribute("aria-valuenow"), bar.get_attribute("aria-valuemax")) == ("4", "12")
    ended, following = site.fake.queued[:2]
    site.fake.queued.remove(ended)
    site.fake.events += [{"episode": ended, "status": "done"}, {"episode": following, "status": "running"}]
    expect(bar).to_have_attribute("aria-valuenow", "5")
    expect(page.locator("#tiles")).to_contain_text("5 / 12")


def test_the_map_counts_crowds_and_lists_what_is_ticked(visit: Visitor) -> None:
    page = visit().go("/evaluations/ev-reckless/map")
    rows = page.locator("tbody tr")
    assert rows.count() == 34
    page.get_by_label("red light run").uncheck()
    assert rows.count() == 24
    assert "#t=" in str(rows.first.locator("a").get_attribute("href"))


def test_a_mark_on_the_map_opens_its_replay_five_seconds_before(visit: Visitor, site: Site) -> None:
    record = site.fake.records["reckless-right-to-south-s0"]
    first = record.egos[0].infractions[0]
    site.fake.records = {"reckless-right-to-south-s0": record.model_copy(update={"egos": (
        record.egos[0].model_copy(update={"infractions": (first,)}),)})}  # fmt: skip
    page = visit().go("/evaluations/ev-reckless/map")
    box = page.locator("canvas").bounding_box()
    assert box is not None
    drawn(page)
    page.mouse.click(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    page.wait_for_url(f"**/episodes/reckless-right-to-south-s0#t={first.time_s - 5:.1f}*")


def test_hostile_names_stay_text(visit: Visitor, site: Site) -> None:
    hostile = "<img src=x onerror=alert(1)>"
    records = site.fake.records
    for name, record in records.items():
        scenario = record.scenario.model_copy(update={"name": hostile})
        records[name] = record.model_copy(update={"scenario": scenario})
    one = visit()
    page = one.go("/evaluations/ev-reckless")
    expect(page.locator("#episodes tbody th").first).to_have_text(hostile)
    assert page.locator("img").count() == 0
    assert one.complaints == []


def test_keyboard_alone_reaches_content_navigation_and_choices(visit: Visitor) -> None:
    page = visit().go("/")
    page.keyboard.press("Tab")
    assert page.evaluate("document.activeElement.textContent") == "Skip to the content"
    seen = []
    for _ in range(24):
        page.keyboard.press("Tab")
        seen.append(
            page.evaluate("document.activeElement.textContent.trim().slice(0, 20) || document.activeElement.name")
        )
    for wanted in ("leaderboard", "evaluations", "API", "sign in", "copy as CSV", "autopilot"):
        assert wanted in seen
    outline = page.evaluate("getComputedStyle(document.activeElement).outlineStyle")
    assert outline != "none"


def test_signing_in_and_out_by_the_page(visit: Visitor) -> None:
    page = visit().go("/login?next=/evaluations")
    page.get_by_label("Token").fill(fakes.TOKEN)
    page.keyboard.press("Enter")
    page.wait_for_url("**/evaluations")
    expect(page.locator("#who")).to_contain_text("lab (submitter)")
    page.get_by_role("button", name="sign out").click()
    expect(page.get_by_role("link", name="sign in")).to_be_visible()


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_text_and_marks_have_the_contrast_of_wcag_aa(visit: Visitor, scheme: str) -> None:
    page = visit(color_scheme=scheme).go("/")
    names = (
        "page",
        "panel",
        "ink",
        "quiet",
        "accent",
        "success",
        "warning",
        "infraction",
        "infrastructure",
        "on-accent",
    )
    names += ("lane", "actor", "person")
    colours = page.evaluate(
        """names => {
          const style = getComputedStyle(document.body);
          return Object.fromEntries(names.map(name => [name, style.getPropertyValue(`--${name}`).trim()]));
        }""",
        list(names),
    )
    light = {name: luminance(colour) for name, colour in colours.items()}
    for text, ground in itertools.product(("ink", "quiet", "accent", "infraction"), ("page", "panel")):
        assert contrast(light[text], light[ground]) >= 4.5, (text, ground)
    for mark, ground in itertools.product(("success", "warning", "infraction", "infrastructure"), ("page", "panel")):
        assert contrast(light[mark], light[ground]) >= 3.0, (mark, ground)
    assert contrast(light["on-accent"], light["accent"]) >= 4.5
    for actor in ("actor", "person", "accent"):
        assert contrast(light[actor], light["lane"]) >= 3.0, actor


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_text_in_the_most_shaded_cell_has_the_contrast_of_wcag_aa(visit: Visitor, scheme: str) -> None:
    page = visit(color_scheme=scheme).go("/agents/reckless")
    ground, *texts = page.locator(".cell").first.evaluate(
        """cell => {
          cell.style.setProperty("--share", 0.35);
          const context = document.createElement("canvas").getContext("2d");
          const painted = (...colours) => {
            for (const colour of colours) { context.fillStyle = colour; context.fillRect(0, 0, 1, 1); }
            const parts = [...context.getImageData(0, 0, 1, 1).data.slice(0, 3)];
            return "#" + parts.map((one) => one.toString(16).padStart(2, "0")).join("");
          };
          const style = (one) => getComputedStyle(one);
          const ground = painted(style(cell.closest(".panel")).backgroundColor, style(cell).backgroundColor);
          return [ground, ...[...cell.querySelectorAll(".cell-name, .quiet")].map((one) => painted(style(one).color))];
        }"""
    )
    assert len(texts) == 2
    assert all(contrast(luminance(text), luminance(ground)) >= 4.5 for text in texts)


def luminance(colour: str) -> float:
    """Relative luminance of "#RRGGBB". Source: WCAG 2.2."""
    channels = [int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def contrast(a: float, b: float) -> float:
    """Contrast ratio of two luminances."""
    return (max(a, b) + 0.05) / (min(a, b) + 0.05)
