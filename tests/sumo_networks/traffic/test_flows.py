"""Flows: who comes, when, where; what cannot come is refused; and traffic without flows is as before."""

from __future__ import annotations

from typing import Any

import libsumo
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from dohyo.sumo_networks.actors.requests import SpawnVehicle
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.scenario import Scenario, Traffic, TrafficFlow
from dohyo.sumo_networks.simulation import plan_scenario
from dohyo.sumo_networks.traffic.flows import FlowSource, make_flow_sources
from dohyo.sumo_networks.traffic.population import NOWHERE, Population
from dohyo.sumo_networks.units import TICK_S
from tests.conftest import Start
from tests.worlds import LANE_M, lit_crossing, straight_road

LIMIT_MPS = 13.89


class Paper:
    """Writes down which vehicle is asked for in which tick."""

    def __init__(self) -> None:
        self.tick, self.entered = 0, list[tuple[int, str, SpawnVehicle]]()

    def run(self, seconds: float, *flows: TrafficFlow, seed: int = 0) -> Paper:
        people = Population(lit_crossing().network, Traffic(flows=flows), np.random.default_rng(seed), lambda _: ())
        assert list(people.fill()) == []
        for self.tick in range(1, round(seconds / TICK_S) + 1):
            last = [name for _, name, _ in self.entered[-1:]]  # a vehicle of a flow is not replaced when it arrives
            for request in people.update(last, (), NOWHERE):
                assert isinstance(request, SpawnVehicle)
                self.entered.append((self.tick, request.name, request))
        return self

    @property
    def times(self) -> np.ndarray:
        return TICK_S * np.array([tick for tick, _, _ in self.entered])


def flow(**changed: Any) -> TrafficFlow:
    return TrafficFlow.model_validate({"source": "w_c", "target": "c_e", "type": "car", **changed})


# When


@settings(deadline=None, max_examples=10)
@given(st.floats(0.5, 30.0), st.floats(0.0, 30.0), st.integers(0, 1000))
def test_gaps_stay_within_their_bounds(shortest: float, more: float, seed: int) -> None:
    paper = Paper().run(600.0, flow(gap_s=(shortest, shortest + more)), seed=seed)
    gaps = np.diff(paper.times)
    assert paper.times[0] <= shortest + more
    assert gaps.min() >= shortest - TICK_S - 1e-9
    assert gaps.max() <= shortest + more + TICK_S + 1e-9


def test_spacing_is_a_gap_at_the_speed_limit() -> None:
    paper = Paper().run(600.0, flow(spacing_m=(5 * LIMIT_MPS, 5 * LIMIT_MPS)))
    assert np.diff(paper.times) == pytest.approx(5.0, abs=TICK_S + 1e-9)


def test_vehicles_per_hour_is_their_mean_and_their_times_are_random() -> None:
    gaps = np.diff(Paper().run(7200.0, flow(vehicles_per_hour=900.0)).times)
    assert len(gaps) == pytest.approx(1800, abs=4 * 1800**0.5)
    assert gaps.std() == pytest.approx(4.0, rel=0.15), "as large as the mean: a Poisson process"


def test_each_flow_has_gaps_of_its_own_and_the_seed_decides_them() -> None:
    one, other = flow(gap_s=(2, 9)), flow(source="n_c", target="c_s", gap_s=(2, 9))
    alone, both, again = Paper().run(300, one), Paper().run(300, one, other), Paper().run(300, one, other)
    assert both.entered == again.entered
    assert [tick for tick, _, trip in both.entered if trip.edges[0] == "w_c"] == [t for t, _, _ in alone.entered]
    assert Paper().run(300, one, seed=1).times.tolist() != alone.times.tolist()


# Who and where


def test_a_flow_keeps_to_its_way_lane_and_type() -> None:
    paper = Paper().run(100.0, flow(source="w_c_1", target="c_n", type="truck", gap_s=(5, 5)))
    trips = {(trip.type, trip.edges, trip.lane, trip.position) for _, _, trip in paper.entered}
    assert trips == {("truck", ("w_c", "c_n"), "1", "base")}


def test_a_flow_without_a_type_is_as_mixed_as_the_population() -> None:
    kinds = [trip.type for _, _, trip in Paper().run(3600.0, flow(type=None, gap_s=(2, 2))).entered]
    assert set(kinds) == {"car", "van", "truck", "bus"}
    assert kinds.count("car") / len(kinds) == pytest.approx(0.84, abs=0.04)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"source": "w_x"}, r"flows\[0\]: network '.*' has no edge 'w_x' \(source\)"),
        ({"target": "c_x"}, r"no edge 'c_x' \(target\)"),
        ({"source": "w_c_7"}, r"no edge 'w_c_7' \(source\)"),
        ({"target": "w_c", "source": "c_e"}, "no path leads from edge 'c_e' to edge 'w_c'"),
        ({"source": ":c_0"}, "no car may drive on edge ':c_0'"),
    ],
)
def test_an_impossible_flow_is_refused_before_sumo_starts(changed: dict[str, str], message: str) -> None:
    scene = lit_crossing()
    traffic = Traffic(flows=(flow(gap_s=(5, 5), **changed),))
    with pytest.raises(InvalidInputError, match=message):
        plan_scenario(scene.network, Scenario(network="x", missions=(scene.mission,), traffic=traffic))


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({}, "got none"),
        ({"gap_s": (3, 4), "vehicles_per_hour": 100}, "got vehicles_per_hour and gap_s"),
        ({"gap_s": (4, 3)}, "shortest gap first"),
        ({"spacing_m": (40, 30)}, "shortest gap first"),
        ({"gap_s": (0.1, 3)}, "greater than or equal to 0.5"),
        ({"spacing_m": (1, 3)}, "greater than or equal to 5"),
        ({"vehicles_per_hour": 0}, "greater than 0"),
        ({"vehicles_per_hour": 1e6}, "less than or equal to 7200"),
        ({"gap_s": (3, 4), "type": "tank"}, "type"),
    ],
)
def test_a_flow_that_means_nothing_is_refused(changed: dict[str, Any], message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        flow(**changed)


# In SUMO


def test_a_flow_drives_through_sumo_on_its_lane_with_its_gaps(start: Start) -> None:
    scene = straight_road()
    traffic = Traffic(warm_up_s=0.0, flows=(flow(source="e_w_1", target="e_w", gap_s=(4.0, 6.0)),))
    simulation, _ = start(Scenario(network=str(scene.network.path), missions=(scene.mission,), traffic=traffic))
    seen: dict[str, float] = {}
    for tick in range(600):
        world = simulation.tick(np.zeros((1, 2)))
        for name in libsumo.vehicle.getIDList():
            if name.startswith("flow") and name not in seen:
                seen[name] = tick * TICK_S
                assert libsumo.vehicle.getLaneID(name) == "e_w_1"
                assert libsumo.vehicle.getTypeID(name).startswith("car")
    assert len(seen) in range(10, 16)
    assert all(3.8 <= gap <= 6.3 for gap in np.diff(list(seen.values())))
    assert world.time == pytest.approx(60.0)
    assert np.abs(world.actors.position[:, 1] - 1.5 * LANE_M).max(initial=0.0) < LANE_M


def test_what_a_scenario_does_not_have_leaves_no_trace() -> None:
    plain = Traffic(vehicles=3)
    assert set(plain.model_dump()) == {"vehicles", "bicycles", "pedestrians", "warm_up_s"}
    assert Traffic.model_validate({**plain.model_dump(), "flows": [], "jaywalkers": 0, "impatience": 0}) == plain
    rng, untouched = np.random.default_rng(0), np.random.default_rng(0)
    assert make_flow_sources(lit_crossing().network, (), rng) == ()
    assert rng.spawn(1)[0].random() == untouched.spawn(1)[0].random()


def test_a_stream_is_never_late_for_long() -> None:
    stream = FlowSource("car", ("a",), None, (2.0, 2.0), 2.0, np.random.default_rng(0))
    assert len(list(stream.due(100.0))) in (50, 51)
    assert list(stream.due(100.0)) == []


# Impatience


def test_impatience_reaches_every_driver_and_no_one_else(start: Start) -> None:
    scene = lit_crossing()
    for impatience in (0.0, 0.7):
        traffic = Traffic(vehicles=2, warm_up_s=0.0, impatience=impatience)
        simulation, _ = start(Scenario(network=str(scene.network.path), missions=(scene.mission,), traffic=traffic))
        told = {kind: libsumo.vehicletype.getImpatience(kind) for kind in ("car", "van", "truck", "bus")}
        assert set(told.values()) == {impatience}
        assert libsumo.vehicletype.getImpatience("ego") == 0.0
        simulation.close()
