"""The map of a network in a real browser: lanes under the pointer, and a mission by two clicks."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect

from dohyo.sumo_networks.networks.catalog import load_network
from dohyo.sumo_networks.networks.drawing import write_map
from dohyo.sumo_networks.networks.network import RoadNetwork
from dohyo.sumo_networks.routes.routing import plan_route
from dohyo.sumo_networks.scenario import Mission
from tests.service.browsing import launched, visiting

# Pixels of a point of the network, in the window.
ON_SCREEN = """([x, y]) => {
    const point = new DOMPoint(x, -y).matrixTransform(document.querySelector("svg").getScreenCTM());
    return [point.x, point.y];
}"""
PIXEL_M = 1.0


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with launched() as chromium:
        yield chromium


@pytest.fixture(scope="module")
def town() -> RoadNetwork:
    return load_network("town-test")


def test_two_clicks_choose_a_mission_that_can_be_driven(browser: Browser, town: RoadNetwork, tmp_path: Path) -> None:
    origin = write_map(town, tmp_path / "map.html").as_uri()
    with visiting(browser, origin) as begin:
        visit = begin()
        visit.page.goto(origin)
        start, goal = ends(town)
        under = point_at(visit.page, town, *start)
        said = re.fullmatch(r"lane (\S+), (\S+) of (\S+) m", under)
        assert said, under
        assert said[1] == start[0]
        assert float(said[2]) == pytest.approx(start[1], abs=PIXEL_M)
        visit.page.mouse.down()
        visit.page.mouse.up()
        point_at(visit.page, town, *goal)
        visit.page.mouse.down()
        visit.page.mouse.up()
        expect(visit.page.locator(".end")).to_have_count(2)
        (written,) = tomllib.loads(visit.page.locator("#mission").inner_text())["missions"]
        visit.page.keyboard.press("+")
        visit.page.locator("#copy").click()
        expect(visit.page.locator("#copy")).to_have_text(re.compile("Copied|Selected: press Ctrl"))
        assert visit.complaints == []
    mission = Mission.model_validate(written)
    assert (mission.start.lane, mission.goal.lane) == (start[0], goal[0])
    assert mission.start.position_m == pytest.approx(start[1], abs=PIXEL_M)
    assert mission.goal.position_m == pytest.approx(goal[1], abs=PIXEL_M)
    assert plan_route(town, mission)


def ends(town: RoadNetwork) -> tuple[tuple[str, float], tuple[str, float]]:
    """The middles of a long lane and of one that it leads to."""
    lanes, connections = town.lanes, town.connections
    outside = lanes.drivable & ~lanes.internal
    long = [lane for lane in connections.source if outside[lane] and lanes.length[lane] > 60.0]
    source = int(long[0])
    inside = connections.target[connections.source == source][0]
    target = int(connections.target[connections.source == inside][0])
    return (str(lanes.ids[source]), lanes.length[source] / 2), (str(lanes.ids[target]), lanes.length[target] / 2)


def point_at(page: Page, town: RoadNetwork, lane: str, position_m: float) -> str:
    """Moves the pointer onto a place, and returns what the page says of it."""
    x, y, _ = town.lane_point(town.lane_index[lane], position_m)
    page.mouse.move(*page.evaluate(ON_SCREEN, [x, y]))
    return page.locator("#under").inner_text()
