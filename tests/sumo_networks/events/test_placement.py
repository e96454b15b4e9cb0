"""Where events fit, by hand and automatically; and what is said where they do not."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from dohyo.sumo_networks.errors import InvalidInputError, UnknownNameError
from dohyo.sumo_networks.events import EVENTS, Event
from dohyo.sumo_networks.events.auto_events import auto_events
from dohyo.sumo_networks.events.placement import check_placement
from dohyo.sumo_networks.networks.catalog import load_network
from dohyo.sumo_networks.scenario import Mission, Place, Scenario
from dohyo.sumo_networks.simulation import plan_scenario
from tests.sumo_networks.events.stories import COUNTRY, EVENT, HIGHWAY, STORIES, TOWN, route_of

NOT_IN_THE_COUNTRY = {
    "right_turn_into_flow",
    "merge_into_slow_traffic",
    "highway_exit",
    "highway_cut_in",
    "parking_exit",
}
PLACES = {"town": TOWN, "country": COUNTRY, "highway": HIGHWAY}


def event(kind: str, at_m: float, **changes: object) -> Event:
    return EVENT.validate_python({"kind": kind, "name": "it", "at_m": at_m, **changes})


@pytest.mark.parametrize(
    ("place", "kind", "at_m", "reason"),
    [
        ("town", "left_turn_unsignalised", 60.0, "has a traffic light"),
        ("town", "accident", 30.0, "no other lane of the same direction"),
        ("town", "highway_cut_in", 30.0, "there is"),
        ("town", "interurban_left_turn", 60.0, "has a traffic light"),
        ("town", "dynamic_object_crossing", 560.0, "the route ends at"),
        ("town", "hard_brake", 90.0, "there is a junction at 129 m"),
        ("town", "yield_to_emergency_vehicle", 200.0, "no second lane"),
        ("town", "parking_exit", 30.0, "only at the start of a route"),
        ("town", "right_turn_into_flow", 60.0, "does not turn right"),
        ("town", "hard_brake", 1e6, "the route ends at"),
        ("country", "opposite_runs_red_light", 350.0, "has no traffic light"),
        ("country", "opposite_runs_red_light", 10.0, "no junction within 150 m"),
        ("country", "parked_obstacle", 100.0, "no other lane of the same direction"),
        ("highway", "parked_obstacle_two_ways", 150.0, "a lane of the same direction to pass the obstacle"),
        ("highway", "oncoming_in_lane", 100.0, "no oncoming lane"),
        ("highway", "highway_exit", 100.0, "no lane change to the right within 400 m"),
    ],
)
def test_an_event_that_does_not_fit_is_an_error_before_sumo_starts(
    place: str, kind: str, at_m: float, reason: str
) -> None:
    network, mission = PLACES[place]
    scenario = Scenario(network=network, missions=(mission,), events=(event(kind, at_m),))
    with pytest.raises(InvalidInputError, match=rf"event 'it' \({kind}\) cannot happen at .*{reason}"):
        plan_scenario(load_network(network), scenario)


@pytest.mark.parametrize("kind", EVENTS)
def test_a_place_on_a_lane_is_as_good_as_metres(kind: str) -> None:
    story = STORIES[kind]
    network, route = load_network(story.place[0]), story.route
    lane = int(route.lane[route.index(story.at_m)])
    if network.lanes.internal[lane] or kind == "parking_exit":
        return
    x, y = route.position[route.index(story.at_m)].tolist()
    on_lane = min(
        np.arange(0.0, network.lanes.length[lane], 0.5),
        key=lambda s: np.hypot(*np.subtract(network.lane_point(lane, float(s))[:2], (x, y))),
    )
    place = {"lane": str(network.lanes.ids[lane]), "position_m": float(on_lane)}
    check_placement(EVENT.validate_python({"kind": kind, "name": "it", "at": place}), "ego", network, route)


def test_a_place_that_the_route_does_not_pass_is_an_error() -> None:
    network, route = load_network(TOWN[0]), route_of(*TOWN)
    elsewhere = EVENT.validate_python({"kind": "hard_brake", "name": "it", "at": {"lane": "-rampart_3_1"}})
    with pytest.raises(InvalidInputError, match=r"the route is .* m away from that place"):
        check_placement(elsewhere, "ego", network, route)
    nowhere = EVENT.validate_python({"kind": "hard_brake", "name": "it", "at": {"lane": "nowhere_0"}})
    with pytest.raises(InvalidInputError, match="network 'town-test' has no such lane"):
        check_placement(nowhere, "ego", network, route)


@pytest.mark.parametrize("position_m", [5000.0, -5000.0])
def test_a_place_off_its_lane_is_an_error(position_m: float) -> None:
    network, mission = TOWN
    start = {"lane": mission.start.lane, "position_m": position_m}
    off = EVENT.validate_python({"kind": "vehicle_appears", "name": "it", "at": start})
    with pytest.raises(InvalidInputError, match=rf"of 'ego': {position_m} m is off the lane, which is .* m long$"):
        check_placement(off, "ego", load_network(network), route_of(*TOWN))


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"kind": "earthquake"}, "does not match any of the expected tags"),
        ({"at": {"lane": "a"}}, "expected either at_m or at"),
        ({"at_m": None}, "expected either at_m or at"),
        ({"at_m": -1.0}, "greater than or equal to 0"),
        ({"speed_mps": 0.0}, "greater than 0"),
        ({"sped_mps": 1.0}, "Extra inputs are not permitted"),
        ({"kind": "highway_exit", "gap_m": (50.0, 20.0)}, "from small to large"),
    ],
)
def test_a_config_that_makes_no_sense_is_an_error(changes: dict[str, object], reason: str) -> None:
    with pytest.raises(ValidationError, match=reason):
        EVENT.validate_python({"kind": "dynamic_object_crossing", "name": "it", "at_m": 10.0, **changes})


def test_a_scenario_names_its_events_and_their_egos() -> None:
    mission = Mission(start=Place(lane="a"), goal=Place(lane="b"))
    with pytest.raises(ValidationError, match="event names must be unique"):
        Scenario(network="x", missions=(mission,), events=(event("hard_brake", 1.0), event("accident", 2.0)))
    with pytest.raises(ValidationError, match="no mission named 'other'"):
        Scenario(network="x", missions=(mission,), events=(event("hard_brake", 1.0, ego="other"),))


def test_the_numbers_of_a_kind_are_its_defaults_and_can_be_changed() -> None:
    assert event("cyclist_after_turn", 1.0).speed_mps == 1.8  # type: ignore[attr-defined]
    assert event("cyclist_after_turn", 1.0, speed_mps=2.5).speed_mps == 2.5  # type: ignore[attr-defined]
    assert event("cyclist_after_turn", 1.0).actor == "bicycle"  # type: ignore[attr-defined]


def test_a_scenario_without_events_is_written_as_before_there_were_any() -> None:
    mission = Mission(start=Place(lane="a"), goal=Place(lane="b"))
    without = Scenario(network="x", missions=(mission,))
    assert "events" not in without.model_dump(mode="json")
    some = without.model_copy(update={"events": (event("hard_brake", 1.0),)})
    assert Scenario.model_validate_json(some.model_dump_json()) == some
    assert some.content_hash() != without.content_hash()


class TestAuto:
    """Placement by `auto_events`."""

    @given(place=st.sampled_from(sorted(PLACES)), seed=st.integers(0, 2**31 - 1), low=st.floats(50.0, 300.0))
    @settings(max_examples=25)
    def test_what_it_places_fits_and_keeps_its_distance(self, place: str, seed: int, low: float) -> None:
        network, route = load_network(PLACES[place][0]), route_of(*PLACES[place])
        events = auto_events(network, route, seed, every_m=(low, low + 50.0))
        for one in events:
            check_placement(one, "ego", network, route)
        assert len({one.name for one in events}) == len(events)
        triggers = [float(one.at_m or 0.0) for one in events]
        assert all(b - a >= low - 0.1 for a, b in itertools.pairwise(triggers))
        assert events == auto_events(network, route, seed, every_m=(low, low + 50.0))

    @given(seed=st.integers(0, 1000), kinds=st.sets(st.sampled_from(sorted(EVENTS)), min_size=1, max_size=4))
    @settings(max_examples=25)
    def test_only_the_kinds_asked_for_come_or_it_is_an_error(self, seed: int, kinds: set[str]) -> None:
        network, route = load_network(COUNTRY[0]), route_of(*COUNTRY)
        if kinds <= NOT_IN_THE_COUNTRY:
            with pytest.raises(InvalidInputError, match="fits anywhere on the route"):
                auto_events(network, route, seed, kinds=sorted(kinds))
        else:
            events = auto_events(network, route, seed, kinds=sorted(kinds))
            assert {one.kind for one in events} <= kinds - NOT_IN_THE_COUNTRY
            assert events

    def test_other_seeds_place_other_events(self) -> None:
        network, route = load_network(COUNTRY[0]), route_of(*COUNTRY)
        assert len({auto_events(network, route, seed) for seed in range(5)}) == 5

    def test_a_long_route_has_many_kinds(self) -> None:
        events = auto_events(load_network(COUNTRY[0]), route_of(*COUNTRY), 0)
        assert len(events) >= 8
        assert len({one.kind for one in events}) == len(events)

    def test_none_that_fits_is_an_error(self) -> None:
        network, route = load_network(TOWN[0]), route_of(*TOWN)
        with pytest.raises(InvalidInputError, match="no event of kind accident fits anywhere"):
            auto_events(network, route, 0, kinds=["accident"])

    def test_wrong_arguments_are_errors(self) -> None:
        network, route = load_network(TOWN[0]), route_of(*TOWN)
        with pytest.raises(UnknownNameError, match="no kind of event named 'hard_break'; did you mean 'hard_brake'"):
            auto_events(network, route, 0, kinds=["hard_break"])
        with pytest.raises(InvalidInputError, match="every_m"):
            auto_events(network, route, 0, every_m=(300.0, 200.0))
