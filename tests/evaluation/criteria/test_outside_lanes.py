from __future__ import annotations

import math

import pytest

from dohyo.evaluation.criteria.outside_lanes import OutsideLanes
from dohyo.evaluation.records.specifications import InfractionKind
from tests.worlds import LANE_M, lit_crossing, run, straight_road


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
