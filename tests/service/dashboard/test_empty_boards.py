"""Boards without a run: commands that the benchmark's family can obey, and how much they drive."""

from __future__ import annotations

from typing import Any

import pytest
from playwright.sync_api import Route, expect

from tests.service.browsing import Visitor
from tests.service.dashboard.conftest import Site
from tests.service.dashboard.fake import BENCHMARKS

QUICKSTART = BENCHMARKS[0].model_dump(mode="json")


def benchmark(name: str, kind: str, scenarios: int, seeds: int, egos: int = 0) -> dict[str, Any]:
    counted = {"scenarios": scenarios, "seeds": list(range(seeds)), "egos": [f"west-{i}" for i in range(egos)]}
    return QUICKSTART | {"name": name, "kind": kind} | counted


KNOWN = [
    QUICKSTART, benchmark("nocrash", "driving", 300, 3), benchmark("fleet", "driving", 1, 3, egos=8),
    benchmark("parking-simple", "parking", 1, 2000), benchmark("dissipation", "freeway", 1, 10),
]  # fmt: skip


@pytest.mark.parametrize(
    ("name", "entry", "amount", "points"),
    [
        ("quickstart", "autopilot", "18 drives (6 scenarios, 3 seeds)", False),
        ("nocrash", "autopilot", "900 drives (300 scenarios, 3 seeds)", True),
        ("fleet", "autopilot", "24 drives (3 seeds, 8 egos)", True),
        ("parking-simple", "parking", "2,000 lots", False),
    ],
)
def test_an_empty_board_says_how_much_its_commands_drive(
    visit: Visitor, site: Site, name: str, entry: str, amount: str, points: bool
) -> None:
    site.fake.empty = True
    one = visit()
    one.page.route("**/v1/benchmarks", lambda route: route.fulfill(json=KNOWN))
    one.page.route("**/cross-play?*", unmet)
    state = one.go(f"/?benchmark={name}").locator(".state")
    expect(state).to_contain_text(f"the built-in agent {entry} and evaluate it in {amount}:")
    expect(state.locator(".command")).to_contain_text(f'{{"kind":"builtin","entry":"{entry}"}}')
    expect(state.get_by_role("link", name="quickstart")).to_have_count(int(points))
    expect(state).to_contain_text("TOKEN: yours, from dohyo tokens create or the organiser.")


def unmet(route: Route) -> None:
    document = {"benchmark": "fleet", "runs": 0, "agents": [], "cells": [], "metric": "driving_score"}
    route.fulfill(json=document | {"dohyo_version": None, "other_versions": 0})


def test_the_empty_board_of_the_freeway_submits_a_planner_with_a_worker(visit: Visitor, site: Site) -> None:
    site.fake.empty = True
    one = visit()
    one.page.route("**/v1/benchmarks", lambda route: route.fulfill(json=KNOWN))
    state = one.go("/?benchmark=dissipation").locator(".state")
    expect(state).to_contain_text("10 mornings")
    commands = state.locator(".command").inner_text()
    assert '"kind":"remote","track":"privileged","sensors":["speeds"],"control":"target_speeds"' in commands
    assert commands.splitlines()[-1] == f'python examples/planner.py {one.origin} "$TOKEN" my-planner'
    assert "autopilot" not in commands


def test_a_list_without_challenges_fits_a_phone(visit: Visitor) -> None:
    one = visit(width=390)
    one.page.route("**/v1/challenges*", lambda route: route.fulfill(json={"items": [], "next": None}))
    page = one.go("/challenges")
    expect(page.locator(".state .command")).to_contain_text("--role organiser")
    assert page.evaluate("document.documentElement.scrollWidth") == 390
