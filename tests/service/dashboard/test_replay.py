"""The replay in a real browser: keys, deep links, camera, lockstep, speed."""

from __future__ import annotations

import re
from itertools import pairwise

import pytest
from playwright.sync_api import Page, expect

from tests.service.dashboard.conftest import Visitor

EPISODE = "/episodes/reckless-right-to-south-s0"
PAIR = "/compare?evaluation=ev-autopilot&evaluation=ev-reckless&scenario=right-to-south-s0"


def seconds(page: Page) -> float:
    """What the clock shows."""
    expect(page.locator(".clock")).not_to_be_empty()  # until the first frame it is
    text = page.locator(".clock").inner_text().partition(" /")[0]
    minutes, _, rest = text.rpartition(":")
    return 60 * int(minutes or 0) + float(rest)


def test_space_plays_arrows_step_and_i_jumps_to_each_infraction(visit: Visitor) -> None:
    page = visit().go(EPISODE)
    assert seconds(page) == 0
    page.keyboard.press("i")
    expect(page.locator(".clock")).to_have_text("12.6 / 19.7 s")
    expect(page.locator(".controls [role=status]")).to_have_text("red light run at 12.6 s")
    page.keyboard.press("i")
    expect(page.locator(".clock")).to_have_text("12.7 / 19.7 s")
    page.keyboard.press("ArrowRight")
    page.keyboard.press("ArrowRight")
    expect(page.locator(".clock")).to_have_text("12.9 / 19.7 s")
    page.keyboard.press("Shift+ArrowLeft")
    expect(page.locator(".clock")).to_have_text("11.9 / 19.7 s")
    page.keyboard.press("Shift+I")
    expect(page.locator(".controls [role=status]")).to_have_text("no earlier infraction")
    page.keyboard.press("Space")
    expect(page.locator(".clock")).not_to_have_text("11.9 / 19.7 s")
    page.keyboard.press("Space")
    stopped = seconds(page)
    assert stopped > 11.9
    page.wait_for_timeout(200)
    assert seconds(page) == stopped


def test_playing_at_eight_times_the_speed_reaches_the_end_and_stops_there(visit: Visitor) -> None:
    page = visit().go(f"{EPISODE}#t=12")
    page.select_option("select[aria-label=speed]", "8")
    page.get_by_role("button", name="play", exact=True).click()
    expect(page.locator(".clock")).to_have_text("19.7 / 19.7 s")
    expect(page.get_by_role("button", name="play", exact=True)).to_be_visible()


def test_the_address_holds_time_and_camera_and_opens_there_again(visit: Visitor) -> None:
    page = visit().go(f"{EPISODE}#t=14.0")
    assert seconds(page) == 14.0
    box = page.locator("canvas").bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + 200, box["y"] + 200)
    page.mouse.down()
    page.mouse.move(box["x"] + 300, box["y"] + 260, steps=4)
    page.mouse.up()
    page.keyboard.press("ArrowRight")
    page.wait_for_url(re.compile(r"#t=14\.1&x="))
    kept = page.evaluate("location.hash")
    expect(page.get_by_role("button", name="follow")).to_have_attribute("aria-pressed", "false")
    again = visit().go(EPISODE + kept)
    assert seconds(again) == 14.1
    again.wait_for_timeout(600)
    assert again.evaluate("location.hash") == kept
    expect(again.get_by_role("button", name="follow")).to_have_attribute("aria-pressed", "false")


def test_a_nonsense_address_is_the_start(visit: Visitor) -> None:
    one = visit()
    page = one.go(f"{EPISODE}#t=NaN&x=a&z=-5&ego=nobody")
    assert seconds(page) == 0
    assert one.complaints == []


def test_the_reasons_of_the_score_are_the_record_s(visit: Visitor) -> None:
    page = visit().go(EPISODE)
    expect(page.locator(".formula")).to_have_text("100 × 0.550 × 0.700 × 0.500³ = 4.81")
    page.locator(".infractions button").nth(3).click()
    expect(page.locator(".clock")).to_have_text("14.0 / 19.7 s")


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_the_ego_is_drawn_in_the_accent_in_the_middle_and_its_lights_are_red(visit: Visitor, scheme: str) -> None:
    page = visit(color_scheme=scheme).go(f"{EPISODE}#t=5.0&z=20")
    near = """accent => {
      const canvas = document.querySelector("canvas");
      const c = canvas.getContext('2d'), k = canvas.width / canvas.clientWidth;
      const [x, y] = [canvas.width / 2 - 4 * k, canvas.height / 2 - 4 * k];
      return String([...c.getImageData(x, y, 1, 1).data].slice(0, 3)) === String(accent);
    }"""
    accent = {"light": [91, 75, 138], "dark": [165, 148, 224]}[scheme]
    page.wait_for_function(near, arg=accent)


def test_two_replays_run_in_lockstep(visit: Visitor) -> None:
    page = visit().go(f"{PAIR}#t=12.6")
    page.wait_for_selector(".stages.paired")
    assert page.locator("canvas").count() == 2
    sliders = page.locator("input.scrub")
    expect(sliders.nth(0)).to_have_js_property("value", "12.6")
    page.keyboard.press("Shift+ArrowRight")
    for i in range(2):
        expect(sliders.nth(i)).to_have_js_property("value", "13.6")
    assert page.locator(".ended:visible").count() == 0
    sliders.nth(0).fill("60")
    expect(page.locator(".ended:visible")).to_have_count(1)


def test_dragging_on_the_timeline_goes_there(visit: Visitor) -> None:
    page = visit().go(EPISODE)
    plot = page.locator(".plot:not(.scrubber)").first
    plot.scroll_into_view_if_needed()
    box = plot.bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + 20, box["y"] + 10)
    page.mouse.down()
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + 10, steps=3)
    page.mouse.up()
    page.mouse.move(box["x"] + 20, box["y"] + 10)
    expect(page.locator(".clock")).to_have_text(re.compile("^9[.][89] "))


def test_nothing_moves_by_itself(visit: Visitor) -> None:
    page = visit(reduced_motion="reduce").go(f"{EPISODE}#t=3")
    page.wait_for_timeout(300)
    assert seconds(page) == 3.0


def test_two_hundred_actors_are_played(visit: Visitor) -> None:
    page = visit().go("/episodes/crowd")
    page.keyboard.press("Space")
    times = page.evaluate(
        """() => new Promise(done => {
          const times = [];
          const frame = now => times.push(now) < 121 ? requestAnimationFrame(frame) : done(times);
          requestAnimationFrame(frame);
        })"""
    )
    spans_ms = [after - before for before, after in pairwise(times)]
    page.keyboard.press("Space")
    assert seconds(page) > 1
    rate = 1000.0 * len(spans_ms) / sum(spans_ms)
    print(f"\n200 actors: {rate:.0f} frames per second in headless chromium without a GPU")
    assert min(spans_ms) < 500.0, "every frame takes more than half a second, on a busy machine, too"


def test_why_it_decides_so_is_found_out_once_and_follows_the_time(visit: Visitor) -> None:
    one = visit()
    page = one.go(f"{EPISODE}#t=5.0")
    plain = page.locator("canvas").screenshot()
    page.get_by_role("button", name="show the agent's reasons").click()
    why = page.locator(".reasons dl")
    expect(why).to_contain_text("target speed60.0rulefree roadroot · n7")
    expect(page.locator(".reasons")).to_contain_text("3 branches of the search")
    assert page.locator("canvas").screenshot() != plain  # its plan is on the road
    page.keyboard.press("ArrowRight")
    expect(why).to_contain_text("target speed61.0")
    page.keyboard.press("i")  # at 12.6 s
    expect(page.locator(".reasons")).to_contain_text("gave no reason for this moment")
    assert one.complaints == []


def test_reasons_that_cannot_be_had_are_told(visit: Visitor) -> None:
    page = visit().go("/episodes/autopilot-right-to-south-s0")
    page.get_by_role("button", name="show the agent's reasons").click()
    expect(page.locator(".reasons .reason")).to_contain_text("has changed since")


def test_a_plan_is_turned_from_the_ego_s_frame_into_the_network_s(visit: Visitor) -> None:
    page = visit().go(EPISODE)
    found = page.evaluate("""async () => {
        const { planOf } = await import("/static/replay/reasons.js");
        const track = { first: 10, count: 2, x: [0, 100], y: [0, 50], heading: [0, Math.PI / 2] };
        const node = (node, n, trajectory) => ({ node, n, trajectory });
        const nodes = [node(1, 4, [[0, 0], [3, 1]]), node(2, 1, [[0, 0], [1, 0]])];
        const round = (points) => points.map((point) => point.map(Math.round));
        const tree = planOf({ plan: [1], nodes }, track, 11);
        const line = planOf({ trajectory: [[2, 0]] }, track, 11);
        return [round(tree.path), tree.explored.map((one) => one.share), round(line.path), planOf({}, track, 9)];
    }""")
    assert found == [[[100, 50], [99, 53]], [1, 0.25], [[100, 52]], None]
