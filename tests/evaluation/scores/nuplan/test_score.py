"""The closed-loop score: every term at both sides of its thresholds, on hand-made drives."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dohyo.evaluation.records.record import EpisodeRecord
from dohyo.evaluation.records.specifications import InfractionKind, Status
from dohyo.evaluation.records.trajectory import Trajectory, TrajectoryRecorder
from dohyo.evaluation.scores.nuplan.frames import frames_of
from dohyo.evaluation.scores.nuplan.score import ClosedLoop, closed_loop, times_to_collision
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.scenario import Scenario
from dohyo.sumo_networks.world import ActorKind
from tests.evaluation.builders import ego, episode, infraction
from tests.worlds import Scene, crossing_for_pedestrians, lit_crossing, straight_road

STEADY = 10.0


def driven(scene: Scene, seconds: float = 4.0, **facts: object) -> tuple[EpisodeRecord, Trajectory]:
    recorder = TrajectoryRecorder()
    for world in scene.worlds(seconds):
        recorder.append(world)
    record = episode(ego(**({"status": Status.FINISHED} | facts)))  # type: ignore[arg-type]
    scenario = Scenario(network="hand-made", missions=(scene.mission,))
    return record.model_copy(update={"scenario": scenario}), recorder.finish()


def scored(scene: Scene, seconds: float = 4.0, reference_m: float = 0.0, **facts: object) -> ClosedLoop:
    record, trajectory = driven(scene, seconds, **facts)
    return closed_loop(record, trajectory, scene.network, reference_m)


def steady() -> Scene:
    return straight_road().with_ego(x=100, speed=STEADY)


def test_a_drive_without_a_flaw_is_100() -> None:
    result = scored(steady(), reference_m=40.0)
    assert result == ClosedLoop(1, 1, 1, 1, 1, 1, pytest.approx(1), 1, 0)  # type: ignore[arg-type]
    assert result.score == pytest.approx(100.0)


def test_the_formula() -> None:
    assert ClosedLoop(1, 1, 1, 1, 0, 0, 0, 0).score == 0
    assert ClosedLoop(1, 1, 0.5, 1, 1, 0, 0.5, 1).score == pytest.approx(100 * 0.5 * (2.5 + 5 + 0 + 2) / 16)
    whole = ClosedLoop(1, 1, 1, 1, 1, 1, 1, 1)
    assert whole.score == 100
    for multiplier in ("no_collision", "drivable_area", "driving_direction", "making_progress"):
        assert dataclasses.replace(whole, **{multiplier: 0}).score == 0


# No at-fault collision.


@pytest.mark.parametrize(
    ("kind", "expected"),
    [
        (ActorKind.CAR, 0.0),
        (ActorKind.BUS, 0.0),
        (ActorKind.BICYCLE, 0.0),
        (ActorKind.PEDESTRIAN, 0.0),
        (ActorKind.STATIC, 0.5),
    ],
)
def test_hitting_something_that_stands_is_at_fault(kind: ActorKind, expected: float) -> None:
    result = scored(steady().with_actor(x=120, kind=kind))
    assert result.no_collision == expected
    assert result.time_to_collision == 0


def test_a_second_object_leaves_nothing() -> None:
    two = steady().with_actor(x=115, kind=ActorKind.STATIC).with_actor(x=125, kind=ActorKind.STATIC)
    assert scored(two).no_collision == 0


def test_a_standing_ego_that_is_hit_is_not_at_fault() -> None:
    scene = straight_road().with_ego(x=100, speed=0).with_actor(x=80, speed=10)
    result = scored(scene)
    assert result.no_collision == 1
    assert result.time_to_collision == 1


def test_an_ego_hit_from_behind_is_not_at_fault_and_only_the_first_overlap_counts() -> None:
    scene = straight_road().with_ego(x=100, speed=2).with_actor(x=90, speed=10)
    assert scored(scene).no_collision == 1  # the other drives through and comes out ahead


def test_a_side_swipe_is_at_fault_only_out_of_the_own_lane() -> None:
    own = straight_road().with_ego(x=100, speed=10).with_actor(x=98, speed=10, left=3.2, drift=-1.0)
    assert scored(own, 1.6).no_collision == 1
    moving = straight_road().with_ego(x=100, speed=10, drift=1.0).with_actor(x=98, speed=10, left=3.2)
    assert scored(moving, 2.0).no_collision == 0


@pytest.mark.parametrize(("beyond", "expected"), [(0.05, 1.0), (0.25, 0.0)])
def test_a_side_swipe_is_at_fault_with_a_corner_beside_the_road(beyond: float, expected: float) -> None:
    scene = straight_road().with_ego(x=100, speed=10, left=-(0.7 + beyond))
    result = scored(scene.with_actor(x=98, speed=10, left=2.5 - beyond, drift=-1.0), 1.6)
    assert (result.no_collision, result.drivable_area) == (expected, 1.0)


def test_another_ego_counts_as_a_vehicle() -> None:
    assert scored(steady().with_ego(x=120, speed=0)).no_collision == 0


# Drivable area.


@pytest.mark.parametrize(("beyond", "expected"), [(0.25, 1.0), (0.35, 0.0)])
def test_a_corner_outside(beyond: float, expected: float) -> None:
    edge = -1.6 - (1.6 - 0.9)  # the ego's right side is then on the road's edge, 1.6 m right of its lane's middle
    scene = straight_road().with_ego(x=100, speed=STEADY, left=-(0.7 + beyond))
    assert edge < 0
    assert scored(scene).drivable_area == expected


# Driving direction.


@pytest.mark.parametrize(("speed", "expected"), [(1.8, 1.0), (2.2, 0.5), (5.5, 0.5), (6.5, 0.0)])
def test_metres_against_the_lane_in_a_second(speed: float, expected: float) -> None:
    wrong_way = straight_road().with_ego(x=500, speed=speed, heading=math.pi)
    assert scored(wrong_way, 3.0).driving_direction == expected


@pytest.mark.parametrize(("speed", "expected"), [(1.9, 1.0), (2.1, 0.5), (5.9, 0.5), (6.1, 0.0)])
def test_lanes_inside_a_junction_have_a_direction_too(speed: float, expected: float) -> None:
    through = lit_crossing().with_ego(x=2, y=lit_crossing().route.position[0, 1], speed=-speed)
    record, trajectory = driven(through, 1.0)
    frames = frames_of(record, trajectory, through.network)
    assert frames.in_junction.all()
    assert scored(through, 1.0).driving_direction == expected


@pytest.mark.parametrize(("forward_s", "expected"), [(0.4, 1.0), (0.2, 0.5)])
def test_metres_forward_count_against_metres_back(forward_s: float, expected: float) -> None:
    """A shuttle at 5 m/s goes back 3 m or 4 m in every second, of which 1 m or 3 m remain."""
    shuttle = straight_road().with_ego(x=500, speed=lambda t: 5.0 if (t - 0.05) % 1.0 < forward_s else -5.0)
    assert scored(shuttle, 3.0).driving_direction == expected


def test_an_ego_beside_all_lanes_has_no_driving_direction() -> None:
    beside = straight_road().with_ego(x=500, speed=10.0, heading=math.pi, left=-6.0)
    assert scored(beside, 2.0).driving_direction == 1


def test_a_short_stretch_against_the_lane_is_forgiven() -> None:
    brief = straight_road().with_ego(x=500, speed=lambda t: 10.0 if t < 0.15 else 0.0, heading=math.pi)
    assert scored(brief, 3.0).driving_direction == 1


# Progress.


@pytest.mark.parametrize(
    ("reference_m", "progress", "makes"), [(20.0, 1.0, 1.0), (80.0, 0.5, 1.0), (190.0, 0.21, 1), (210.0, 0.19, 0)]
)
def test_progress_is_that_of_the_reference(reference_m: float, progress: float, makes: float) -> None:
    result = scored(steady(), 4.0, reference_m)
    assert result.progress == pytest.approx(progress, abs=0.005)
    assert result.making_progress == makes


@pytest.mark.parametrize(
    ("reference_m", "progress", "makes"),
    [(0.05, 1.0, 1), (1.9, 1.0, 1), (2.5, 0.8, 1), (9.9, 0.202, 1), (10.1, 0.198, 0)],
)
def test_a_standing_ego_counts_as_if_it_had_come_2_m(reference_m: float, progress: float, makes: float) -> None:
    standing = scored(straight_road().with_ego(x=100, speed=0), reference_m=reference_m)
    assert (standing.progress, standing.making_progress) == (pytest.approx(progress, abs=5e-4), makes)


@pytest.mark.parametrize(("metres", "progress"), [(1.5, 0.1), (2.5, 0.125), (-1.9, 0.1), (-2.1, 0.0)])
def test_progress_is_at_least_2_m_but_for_an_ego_that_goes_back_further(metres: float, progress: float) -> None:
    result = scored(straight_road().with_ego(x=100, speed=metres), 1.0, reference_m=20.0)
    assert result.progress == pytest.approx(progress, abs=1e-3)


def test_progress_is_where_the_drive_ends_not_its_furthest_point() -> None:
    there_and_back = straight_road().with_ego(x=100, speed=lambda t: 5.0 if t < 2.05 else -5.0)
    assert scored(there_and_back, 3.0, reference_m=10.0).progress == pytest.approx(0.5, abs=0.01)


# Time to collision.


@pytest.mark.parametrize(("gap_s", "expected"), [(0.85, 0.0), (1.05, 1.0)])
def test_time_to_a_standing_car(gap_s: float, expected: float) -> None:
    """The ego stops being so near after one tick, so that the smallest time is that at the start."""
    x = 100 + 4.5 + STEADY * gap_s
    scene = straight_road().with_ego(x=100, speed=lambda t: 0.0 if t > 0 else STEADY).with_actor(x=x)
    record, trajectory = driven(scene, 1.0)
    times = times_to_collision(frames_of(record, trajectory, scene.network))
    assert (times[0] > 0.95) == bool(expected)
    assert math.isinf(times[-1])  # it stands
    assert scored(scene, 1.0).time_to_collision == expected


@pytest.mark.parametrize(("speed", "expected"), [(0.006, 0.0), (0.004, 1.0)])
def test_only_a_standing_ego_meets_nobody(speed: float, expected: float) -> None:
    oncoming = straight_road().with_ego(x=100, speed=speed).with_actor(x=107, speed=10, heading=math.pi)
    assert scored(oncoming, 0.1).time_to_collision == expected


def test_a_leader_of_the_same_speed_is_no_danger_however_near() -> None:
    assert scored(steady().with_actor(x=105.5, speed=STEADY)).time_to_collision == 1


def test_who_comes_beside_counts_only_while_the_ego_is_not_in_one_lane() -> None:
    beside = straight_road().with_ego(x=100, speed=STEADY).with_actor(x=102, speed=STEADY, left=3.2, heading=-0.3)
    assert scored(beside, 0.1).time_to_collision == 1
    straddling = straight_road().with_ego(x=100, speed=STEADY, left=1.4)
    straddling = straddling.with_actor(x=102, speed=STEADY, left=4.2, heading=-0.3)
    assert scored(straddling, 0.1).time_to_collision == 0


def test_who_comes_from_behind_never_counts() -> None:
    assert scored(steady().with_actor(x=92, speed=20), 0.1).time_to_collision == 1


# Speed limit.


@pytest.mark.parametrize(("over", "expected"), [(-0.5, 1.0), (0.0, 1.0), (1.115, 0.5), (2.23, 0.0), (9.0, 0.0)])
def test_overspeed_for_the_whole_drive(over: float, expected: float) -> None:
    scene = straight_road().with_ego(x=100, speed=13.89 + over)
    assert scored(scene, reference_m=50).speed_limit == pytest.approx(expected, abs=1e-3)


def test_overspeed_for_half_of_the_drive() -> None:
    scene = straight_road().with_ego(x=100, speed=lambda t: 13.89 + (2.23 if t > 2.0 else 0.0))
    assert scored(scene, 4.0).speed_limit == pytest.approx(0.5, abs=0.02)


# Comfort.


@pytest.mark.parametrize(("acceleration", "expected"), [(2.3, 1.0), (2.5, 0.0), (-3.9, 1.0), (-4.2, 0.0)])
def test_longitudinal_acceleration(acceleration: float, expected: float) -> None:
    scene = straight_road().with_ego(x=100, speed=lambda t: 13.0 + acceleration * t)
    assert scored(scene, 3.0).comfort == expected


@pytest.mark.parametrize(("jerk", "expected"), [(4.0, 1.0), (4.3, 0.0)])
def test_longitudinal_jerk(jerk: float, expected: float) -> None:
    """The acceleration falls at a steady rate, within its own bounds."""
    scene = straight_road().with_ego(x=100, speed=lambda t: 8.0 - 0.5 * jerk * (t - 0.45) ** 2)
    assert scored(scene, 1.2).comfort == expected


@pytest.mark.parametrize("seconds", [0.0, 0.1, 0.2])
def test_a_drive_too_short_for_a_derivative_is_comfortable(seconds: float) -> None:
    assert scored(straight_road().with_ego(x=100, speed=lambda t: 10.0 * (t > 0)), seconds).comfort == float(
        seconds < 0.2
    )


def turning(scene: Scene, rate: float, speed: float, seconds: float) -> ClosedLoop:
    """An ego on a circle: its rows of the trajectory are rewritten."""
    record, trajectory = driven(scene.with_ego(x=500, speed=speed), seconds)
    rows = np.flatnonzero(trajectory.key == -1)
    heading = np.array(trajectory.heading)
    heading[rows] = rate * 0.1 * np.arange(len(rows))
    columns = {name: getattr(trajectory, name) for name in Trajectory.__slots__}
    return closed_loop(record, Trajectory(**(columns | {"heading": heading})), scene.network, 0.0)


@pytest.mark.parametrize(
    ("rate", "speed", "expected"), [(0.9, 3.0, 1.0), (1.0, 3.0, 0.0), (0.4, 12.0, 1.0), (0.42, 12.0, 0.0)]
)
def test_yaw_rate_and_lateral_acceleration(rate: float, speed: float, expected: float) -> None:
    """0.95 rad/s, and 4.89 m/s^2, which 12 m/s reach at 0.4075 rad/s."""
    assert turning(straight_road(), rate, speed, 3.0).comfort == expected


# Beside the terms.


def test_red_lights_are_counted_and_enter_no_term() -> None:
    record, trajectory = driven(steady())
    red = record.egos[0].model_copy(update={"infractions": (infraction(InfractionKind.RED_LIGHT),)})
    result = closed_loop(record.model_copy(update={"egos": (red,)}), trajectory, straight_road().network, 40.0)
    assert result.red_lights == 1
    assert result.score == pytest.approx(100.0)


@pytest.mark.parametrize(
    "status", [Status.AGENT_SETUP, Status.AGENT_RAISED, Status.AGENT_ACTION, Status.AGENT_DEADLINE]
)
def test_an_agent_that_failed_as_a_program_has_nothing(status: Status) -> None:
    assert scored(steady(), status=status).score == 0


@pytest.mark.parametrize("reference", [-1.0, math.nan, math.inf])
def test_a_reference_that_is_no_distance(reference: float) -> None:
    record, trajectory = driven(steady())
    with pytest.raises(InvalidInputError, match="reference's progress"):
        closed_loop(record, trajectory, straight_road().network, reference)


def test_a_trajectory_with_a_gap_is_refused() -> None:
    record, trajectory = driven(steady())
    keep = trajectory.tick != 7
    columns = {name: getattr(trajectory, name) for name in Trajectory.__slots__}
    cut = {name: column[keep] for name, column in columns.items() if name not in ("names", "signals")}
    with pytest.raises(InvalidInputError, match="every tick"):
        closed_loop(record, Trajectory(**(columns | cut)), straight_road().network, 40.0)


# Properties.

ACTORS = st.tuples(
    st.floats(60, 160), st.floats(-6, 12), st.floats(0, 15), st.floats(-3, 3), st.sampled_from(list(ActorKind)[:8])
)


@settings(max_examples=25, deadline=None)
@given(speed=st.floats(0, 25), left=st.floats(-3, 10), actors=st.lists(ACTORS, max_size=3), one=ACTORS)
def test_the_score_is_a_percentage_and_one_more_actor_never_raises_it(
    speed: float, left: float, actors: list[tuple[float, float, float, float, ActorKind]], one: tuple[float, ...]
) -> None:
    scene = straight_road().with_ego(x=100, speed=speed, left=left)
    for x, y, v, heading, kind in actors:
        scene = scene.with_actor(x, v, kind=kind, left=y, heading=heading)
    result = scored(scene, 1.5, reference_m=20.0)
    assert 0 <= result.score <= 100
    more = scored(scene.with_actor(one[0], one[2], kind=one[4], left=one[1], heading=one[3]), 1.5, reference_m=20.0)  # type: ignore[arg-type]
    assert more.score <= result.score + 1e-9


def _scenes() -> dict[str, Callable[[], Scene]]:
    return {
        "a crash": lambda: steady().with_actor(x=125).with_actor(x=110, speed=9, left=3.2),
        "a junction": lambda: lit_crossing().with_ego(x=-30, speed=9).with_actor(x=5, speed=5, y=20, heading=-1.57),
        "off the road": lambda: straight_road().with_ego(x=100, speed=15, left=-2),
        "a crossing": lambda: crossing_for_pedestrians().with_ego(x=-40, speed=8).with_pedestrian(-10, 1, y=-9),
    }


@pytest.mark.parametrize("name", _scenes())
@settings(max_examples=6, deadline=None)
@given(angle=st.floats(-3, 3), dx=st.floats(-900, 900), dy=st.floats(-900, 900))
def test_the_terms_do_not_depend_on_where_the_world_is(name: str, angle: float, dx: float, dy: float) -> None:
    scene = _scenes()[name]()
    here, there = scored(scene, 2.0, 20.0), scored(scene.transformed(dx, dy, angle), 2.0, 20.0)
    assert [getattr(there, term) for term in ClosedLoop.__slots__] == pytest.approx(
        [getattr(here, term) for term in ClosedLoop.__slots__], abs=1e-3
    )
