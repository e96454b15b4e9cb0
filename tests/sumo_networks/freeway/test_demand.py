"""Who comes when: the morning's peak, what a seed decides, and the route file."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.freeway.demand import check_incidents, draw_demand, lane_at, share_of_peak, write_routes
from dohyo.sumo_networks.freeway.drivers import CONNECTED, KINDS, TRUCK
from dohyo.sumo_networks.freeway.road import load_freeway
from dohyo.sumo_networks.freeway.scenario import DAY_S, Day, FreewayScenario, Incident, draw_day

ROAD = load_freeway()
CLOCK = np.arange(0.0, DAY_S, 60.0)


def test_a_weekday_has_its_peak_in_the_morning_and_a_weekend_has_none() -> None:
    weekday, weekend = share_of_peak(Day(weekday=2), CLOCK), share_of_peak(Day(weekday=6), CLOCK)
    assert 6.5 < CLOCK[weekday.argmax()] / 3600 < 8.0
    assert weekday.max() == pytest.approx(1.0, abs=0.05)
    assert weekend[(CLOCK > 6 * 3600) & (CLOCK < 9 * 3600)].max() < 0.5
    assert weekday.min() > 0 < weekend.min()


def test_a_late_peak_is_late_and_a_wide_one_is_wide() -> None:
    usual, late = share_of_peak(Day(), CLOCK), share_of_peak(Day(peak_shift_s=1200), CLOCK)
    assert CLOCK[late.argmax()] - CLOCK[usual.argmax()] == pytest.approx(1200, abs=120)
    assert (share_of_peak(Day(peak_width=1.2), CLOCK) > 0.9).sum() > 1.1 * (usual > 0.9).sum()


def test_as_many_come_as_the_peak_says() -> None:
    demand = draw_demand(ROAD, FreewayScenario(seed=3, start_s=6.9 * 3600, duration_s=1800, warm_up_s=0))
    expected = (5950 + 500 + 460 + 680) / 2
    assert len(demand.time_s) == pytest.approx(expected, abs=5 * expected**0.5)
    assert np.all(np.diff(demand.time_s) >= 0)
    assert set(np.unique(demand.entry)) == {0, 1, 2, 3}
    assert set(np.unique(demand.exit)) == {0, 1, 2, 3, 4}


def test_nobody_leaves_before_the_entry() -> None:
    demand = draw_demand(ROAD, FreewayScenario(seed=3, duration_s=7200))
    assert np.all(ROAD.joins_m[demand.entry] < ROAD.leaves_m[demand.exit])


@given(st.integers(0, 10_000), st.floats(0, 1), st.floats(0, 1))
def test_penetration_and_probes_change_nothing_but_who_is_connected(seed: int, linked: float, probes: float) -> None:
    """Arms of an experiment are paired: the same people drive, and only the set that can be commanded differs."""
    plain = draw_demand(ROAD, FreewayScenario(seed=seed, duration_s=300))
    other = draw_demand(ROAD, FreewayScenario(seed=seed, duration_s=300, penetration=linked, probes=probes))
    for column in ("time_s", "entry", "exit"):
        assert np.array_equal(getattr(plain, column), getattr(other, column))
    truck = KINDS.index(TRUCK)
    assert np.array_equal(plain.kind == truck, other.kind == truck)
    assert np.mean(other.kind[other.kind != truck] == KINDS.index(CONNECTED)) == pytest.approx(linked, abs=0.15)


def test_more_connected_vehicles_include_the_fewer() -> None:
    few, many = (
        draw_demand(ROAD, FreewayScenario(seed=1, duration_s=600, penetration=share)).kind == KINDS.index(CONNECTED)
        for share in (0.05, 0.1)
    )
    assert few.sum() < many.sum()
    assert not (few & ~many).any()


def test_another_seed_is_another_morning() -> None:
    one, other = (draw_demand(ROAD, FreewayScenario(seed=seed, duration_s=600)).time_s for seed in (1, 2))
    assert len(one) != len(other) or not np.array_equal(one, other)


def test_days_differ_and_repeat() -> None:
    days = [draw_day(number % 7, np.random.SeedSequence(number), ROAD) for number in range(120)]
    again = [draw_day(number % 7, np.random.SeedSequence(number), ROAD) for number in range(120)]
    assert days == again
    assert len({day.demand for day in days}) > 110, "the largest and the smallest are cut off"
    assert 6 <= sum(bool(day.incidents) for day in days) <= 60


@pytest.mark.parametrize("name", ["freeway", "a10"])
def test_an_incident_of_a_drawn_day_always_has_its_lane(name: str) -> None:
    road = load_freeway(name)
    drawn = [one for seed in range(600) for one in draw_day(1, np.random.SeedSequence(seed), road).incidents]
    assert len(drawn) > 100
    for one in drawn:
        lane_at(road, one)
    assert len({one.lane for one in drawn}) > 2


@pytest.mark.parametrize("name", ["freeway", "a10"])
def test_an_incident_inside_a_junction_stops_its_car_at_the_end_of_its_lane(name: str, tmp_path: Path) -> None:
    road = load_freeway(name)
    lanes, row = road.network.lanes, road.network.lane_index
    ends = [road.tracks[f"{edge}_0"].start_m + lanes.length[row[f"{edge}_0"]] for edge in road.mainline.edges]
    places = sorted(float(end) + beyond for end in ends for beyond in (-30.0, -0.06, -0.01, 0.005, 0.05, 0.2))
    on_road = [place for place in places if 0 <= place < road.bounds_m[-1]]
    assert len(on_road) > 15
    day = Day(incidents=tuple(Incident(time_s=7 * 3600, duration_s=60, position_m=at, lane=0) for at in on_road))
    scenario = FreewayScenario(network=name, duration_s=60, warm_up_s=0, day=day)
    write_routes(road, scenario, draw_demand(road, scenario), tmp_path / "routes.xml")
    stops = {wreck.attrib["id"]: wreck.find("stop") for wreck in ElementTree.parse(tmp_path / "routes.xml").getroot()}
    for number, at in enumerate(on_road):
        stop = stops[f"wreck{number}"]
        assert stop is not None
        length = float(lanes.length[row[stop.attrib["lane"]]])
        along = max(road.edge_at(at)[1], 10.0)
        assert float(stop.attrib["endPos"]) <= length
        assert float(stop.attrib["endPos"]) == pytest.approx(min(along, length), abs=0.1)
        if along < length - 0.1:
            assert stop.attrib["endPos"] == f"{along:.1f}"


def test_the_route_file_has_every_vehicle_and_the_incident(tmp_path: Path) -> None:
    incident = Incident(time_s=6.2 * 3600, duration_s=900, position_m=5000.0, lane=0)
    scenario = FreewayScenario(duration_s=900, day=Day(incidents=(incident,)))
    demand = draw_demand(ROAD, scenario)
    write_routes(ROAD, scenario, demand, tmp_path / "routes.xml")
    root = ElementTree.parse(tmp_path / "routes.xml").getroot()
    vehicles = root.findall("vehicle")
    assert len(vehicles) == len(demand.time_s) + 1
    times = [float(vehicle.attrib["depart"]) for vehicle in vehicles]
    assert times == sorted(times)
    (stop,) = root.iter("stop")
    assert stop.attrib["lane"].startswith("m09")
    assert stop.attrib["duration"] == "900"


@pytest.mark.parametrize(
    ("position_m", "lane", "message"),
    [(20_000.0, 0, "expected a position in"), (3000.0, 7, "expected a lane from 0 to")],
)
def test_an_incident_beside_the_road_is_refused(tmp_path: Path, position_m: float, lane: int, message: str) -> None:
    incident = Incident(time_s=6.2 * 3600, duration_s=900, position_m=position_m, lane=lane)
    scenario = FreewayScenario(duration_s=900, day=Day(incidents=(incident,)))
    with pytest.raises(InvalidInputError, match=message):
        write_routes(ROAD, scenario, draw_demand(ROAD, scenario), tmp_path / "routes.xml")


def with_incident(after_start_s: float, warm_up_s: float, start_s: float = 6 * 3600.0) -> FreewayScenario:
    incident = Incident(time_s=start_s + after_start_s, duration_s=900, position_m=9000.0, lane=0)
    return FreewayScenario(start_s=start_s, duration_s=900, warm_up_s=warm_up_s, day=Day(incidents=(incident,)))


@pytest.mark.parametrize("after_start_s", [-60.0, 30.0, 300.0])
def test_an_incident_that_no_car_reaches_in_time_is_refused_with_the_warm_up_it_needs(
    after_start_s: float, tmp_path: Path
) -> None:
    with pytest.raises(InvalidInputError, match=r"^incident at 9000 m: .* warm-up of at least .* got 60 s$") as said:
        check_incidents(ROAD, with_incident(after_start_s, 60.0))
    needed = float(re.findall(r"at least (\d+) s", str(said.value))[0])
    assert needed > 60.0
    enough = with_incident(after_start_s, needed)
    check_incidents(ROAD, enough)
    write_routes(ROAD, enough, draw_demand(ROAD, enough), tmp_path / "routes.xml")
    assert "wreck0" in (tmp_path / "routes.xml").read_text()
    with pytest.raises(InvalidInputError, match="a warm-up of at least"):
        check_incidents(ROAD, with_incident(after_start_s, needed - 1.0))


def test_an_incident_just_after_midnight_is_refused_whatever_the_warm_up() -> None:
    with pytest.raises(InvalidInputError, match=r"expected a time of at least 3\d\d s since midnight, got 30 s"):
        check_incidents(ROAD, with_incident(30.0, 600.0, start_s=0.0))


def test_an_incident_before_the_warm_up_is_left_out(tmp_path: Path) -> None:
    before = with_incident(-100.0, 60.0)
    check_incidents(ROAD, before)
    write_routes(ROAD, before, draw_demand(ROAD, before), tmp_path / "routes.xml")
    assert "wreck" not in (tmp_path / "routes.xml").read_text()


def test_a_scenario_ends_before_midnight() -> None:
    with pytest.raises(ValueError, match="expected an end before midnight"):
        FreewayScenario(start_s=80_000, duration_s=10_000)
