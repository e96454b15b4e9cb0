from __future__ import annotations

import dataclasses
import math

import pytest

from dohyo.evaluation.criteria.outside_lanes import TWO_WAYS, OutsideLanes
from dohyo.evaluation.records.specifications import InfractionKind
from dohyo.sumo_networks.world import EventPhase, EventState, World
from tests.worlds import LANE_M, Scene, lit_crossing, run, straight_road


def beside_an_event(
    scene: Scene,
    kind: str = "accident_two_ways",
    *,
    ego: int = 0,
    phase: EventPhase = EventPhase.ACTIVE,
    ahead: float = 10.0,
) -> list[World]:
    """The worlds of a scene in which an event is in a phase, with its obstacle so far ahead of its ego [m]."""
    event = EventState("it", kind, ego, phase, 0.0, math.nan, (), ahead)
    return [dataclasses.replace(world, events=(event,)) for world in scene.worlds(seconds=2)]


@pytest.mark.parametrize(("beyond_m", "metres"), [(0.4, 0.0), (0.49, 0.0), (0.51, 20.0), (0.6, 20.0)])
def test_half_a_metre_beyond_the_lanes_edge_is_allowed(beyond_m: float, metres: float) -> None:
    scene = straight_road().with_ego(x=50, speed=10, left=-LANE_M / 2 - beyond_m)
    verdict = run(scene, OutsideLanes(), seconds=2)
    assert verdict.outside_lanes_m == pytest.approx(metres)
    assert len(verdict.infractions) == (metres > 0)


@pytest.mark.parametrize("left", [0.0, 1.0, LANE_M / 2, LANE_M])
def test_any_place_on_the_own_side_is_inside(left: float) -> None:
    assert run(straight_road().with_ego(x=50, speed=10, left=left), OutsideLanes()).infractions == []


def test_an_opposing_lane_is_outside() -> None:
    scene = straight_road().with_ego(x=50, speed=10, left=2 * LANE_M)
    (infraction,) = run(scene, OutsideLanes(), seconds=2).infractions
    assert infraction.magnitude == pytest.approx(20.0)
    assert infraction.actor == "e_w_1"


@pytest.mark.parametrize("kind", sorted(TWO_WAYS))
@pytest.mark.parametrize("ahead", [60.0, -12.0])
def test_the_oncoming_lane_is_open_beside_an_obstacle_of_both_directions(kind: str, ahead: float) -> None:
    scene = straight_road().with_ego(x=50, speed=10, left=2 * LANE_M)
    verdict = run(beside_an_event(scene, kind, ahead=ahead), OutsideLanes())
    assert (verdict.infractions, verdict.outside_lanes_m) == ([], 0.0)


@pytest.mark.parametrize("kind", ["accident", "vehicle_opens_door", "hard_brake"])
def test_other_events_leave_it_closed(kind: str) -> None:
    scene = straight_road().with_ego(x=50, speed=10, left=2 * LANE_M)
    assert run(beside_an_event(scene, kind), OutsideLanes()).outside_lanes_m == pytest.approx(20.0)


@pytest.mark.parametrize("phase", [EventPhase.WAITING, EventPhase.DONE, EventPhase.TIMED_OUT])
def test_it_is_closed_before_and_after_the_event(phase: EventPhase) -> None:
    scene = straight_road().with_ego(x=50, speed=10, left=2 * LANE_M)
    assert run(beside_an_event(scene, phase=phase), OutsideLanes()).outside_lanes_m == pytest.approx(20.0)


@pytest.mark.parametrize("ahead", [150.0, -150.0, math.nan])
def test_it_is_closed_far_from_the_event(ahead: float) -> None:
    scene = straight_road().with_ego(x=50, speed=10, left=2 * LANE_M)
    assert run(beside_an_event(scene, ahead=ahead), OutsideLanes()).outside_lanes_m == pytest.approx(20.0)


def test_it_is_closed_to_other_egos_and_to_who_drives_back() -> None:
    scene = straight_road().with_ego(x=500, speed=10, left=2 * LANE_M)
    assert run(beside_an_event(scene, ego=1), OutsideLanes()).outside_lanes_m == pytest.approx(20.0)
    back = straight_road().with_ego(x=500, speed=10, heading=math.pi)
    assert run(beside_an_event(back), OutsideLanes()).outside_lanes_m == pytest.approx(20.0)


@pytest.mark.parametrize("left", [-5.0, 13.0])
def test_off_all_lanes_is_outside_beside_an_event_too(left: float) -> None:
    scene = straight_road().with_ego(x=50, speed=10, left=left)
    assert run(beside_an_event(scene), OutsideLanes()).outside_lanes_m == pytest.approx(20.0)


def test_driving_against_ones_own_lane_is_outside() -> None:
    scene = straight_road().with_ego(x=500, speed=10, heading=math.pi)
    assert run(scene, OutsideLanes(), seconds=2).outside_lanes_m == pytest.approx(20.0)


def test_directions_do_not_count_inside_a_junction() -> None:
    scene = lit_crossing().with_ego(x=5, speed=4, heading=math.pi)
    assert run(scene, OutsideLanes(), seconds=2).infractions == []


def test_a_right_turn_across_the_lanes_of_a_junction_is_inside() -> None:
    scene = lit_crossing().with_ego(x=4.8, y=-8, speed=8, heading=math.pi / 2)
    assert run(scene, OutsideLanes(), seconds=2).infractions == []


def test_far_from_every_lane_is_outside() -> None:
    scene = straight_road().with_ego(x=500, speed=10, left=-150)
    assert scene.world().egos.lane[0] == -1
    (infraction,) = run(scene, OutsideLanes(), seconds=1).infractions
    assert infraction.magnitude == pytest.approx(10.0)
    assert infraction.actor is None


def test_standing_outside_is_no_distance() -> None:
    verdict = run(straight_road().with_ego(x=50, speed=0, left=-5), OutsideLanes())
    assert (verdict.infractions, verdict.outside_lanes_m) == ([], 0.0)


def test_two_departures_are_one_infraction_at_the_first() -> None:
    def drift(time: float) -> float:
        """Drifts out at 4 m/s from 0.5 s and from 3.5 s on, and back 1.5 s later."""
        phase = (time - 1e-9) % 3.0
        return -4.0 if 0.5 < phase < 1.0 else 4.0 if 2.0 < phase < 2.5 else 0.0

    scene = straight_road().with_ego(x=50, speed=10, left=-1.0, drift=drift)
    verdict = run(scene, OutsideLanes(), seconds=6)
    (infraction,) = verdict.infractions
    assert infraction.kind is InfractionKind.OUTSIDE_LANES
    assert infraction.magnitude == pytest.approx(verdict.outside_lanes_m)
    assert 24.0 < verdict.outside_lanes_m < 32.0
    assert infraction.time_s == pytest.approx(0.8)
    assert infraction.x_m == pytest.approx(58.0)
    assert infraction.unit == "m"
