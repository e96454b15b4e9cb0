"""Forms in a real browser: what is chosen can be read."""

from __future__ import annotations

from dohyo.service.dashboard.session import COOKIE
from tests.service.browsing import Visitor
from tests.service.dashboard.fake import TOKEN
from tests.service.dashboard.test_comparisons import answering

CUT = """() => [...document.querySelectorAll("form select")].filter((one) => {
  const whole = one.cloneNode(true);
  Object.assign(whole.style, { width: "max-content", maxWidth: "none" });
  one.after(whole);
  const wanted = whole.offsetWidth;
  whole.remove();
  return one.offsetWidth && wanted > one.offsetWidth;
}).map((one) => one.name)"""
"""Choices that are wider than their fields."""


def test_the_choices_of_a_submission_are_not_cut(visit: Visitor) -> None:
    one = visit()
    one.page.context.add_cookies([{"name": COOKIE, "value": TOKEN, "url": one.origin}])
    answers = {
        "agents?*": {"items": [], "next": None},
        "observations": {"controls": {"target_speed_steering": {}, "acceleration_steering": {}}},
    }
    for path, answer in answers.items():
        one.page.route(f"**/v1/{path}", answering(answer))
    page = one.go("/submit")
    assert page.locator("form select").count() == 4
    for width in (1280, 1024, 390):
        page.set_viewport_size({"width": width, "height": 900})
        assert page.evaluate(CUT) == []
