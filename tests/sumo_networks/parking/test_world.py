"""Parking, contact, alignment, dwell, targets: hand-made lots whose outcome can be computed by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.parking import kart
from dohyo.sumo_networks.parking.generate import Scene
from dohyo.sumo_networks.parking.lot import Block, Lot, ParkedCar, Pedestrian, Pose, Spot, Wall
from dohyo.sumo_networks.parking.radar import Kind
from dohyo.sumo_networks.parking.rules import ALIGNED, JUDGED, LITERAL, SIMPLE, WITHOUT_DWELL, Outcome, Rules
from dohyo.sumo_networks.parking.tables import TARGET
from dohyo.sumo_networks.parking.world import ParkingWorld
from tests.sumo_networks.parking.lots import REST, SPOT, drive, lot_of, moving, outcome, world_of

NORTH = math.pi / 2
IN_PLACE = Pose(x_m=0.0, y_m=0.0, heading_rad=NORTH)
ROLL = np.array([0.0, 0.0, -1.0])


def test_a_kart_that_rolls_into_its_spot_and_brakes_parks_aligned():
    world = moving(world_of(lot_of(Pose(x_m=0.05, y_m=-3.0, heading_rad=NORTH))), 2.0)
    drive(world, ROLL, 12)
    results = drive(world, REST).results()
    assert results.outcome[0, 0] == Outcome.PARKED
    assert results.aligned[0, 0]
    assert results.deviation_m[0, 0] == pytest.approx(0.05, abs=1e-6)
    assert results.driven_m[0, 0] == pytest.approx(3.0 - results.distance_m[0, 0], abs=0.05)
    assert results.touched[0, 0] == Kind.NOTHING


@pytest.mark.parametrize(("gap_m", "ended"), [(-0.01, Outcome.COLLIDED), (0.01, Outcome.PARKED)])
def test_a_corner_is_scraped_or_missed_by_a_centimetre(gap_m, ended):
    """The front left corner of the kart passes the corner of a block on its way into the spot."""
    corner = -kart.WIDTH_M / 2 - gap_m
    block = Block(x_m=corner - 0.5, y_m=-1.5, heading_rad=0.0, length_m=1.0, width_m=1.0)
    spot = SPOT.model_copy(update={"length_m": kart.LENGTH_M})
    start = Pose(x_m=0.0, y_m=-3.0, heading_rad=NORTH)
    world = moving(world_of(lot_of(start, spots=(spot,), blocks=(block,))), 2.0)
    drive(world, ROLL, 12)
    assert outcome(drive(world, REST)) == ended
    assert world.results().touched[0, 0] == (Kind.WALL if gap_m < 0 else Kind.NOTHING)


@pytest.mark.parametrize(
    ("degrees", "aligned"), [(2.9, True), (3.1, False), (-2.9, True), (-3.1, False), (178.0, True)]
)
def test_alignment_is_an_angle_of_at_most_three_degrees(degrees, aligned):
    pose = IN_PLACE.model_copy(update={"heading_rad": NORTH + math.radians(degrees)})
    results = drive(world_of(lot_of(pose))).results()
    assert results.success[0, 0]
    assert results.aligned[0, 0] == aligned


@pytest.mark.parametrize(("sideways_m", "aligned"), [(0.19, True), (0.21, False)])
def test_alignment_is_a_deviation_below_20_cm(sideways_m, aligned):
    results = drive(world_of(lot_of(IN_PLACE.model_copy(update={"x_m": sideways_m, "y_m": 0.3})))).results()
    assert results.success[0, 0]
    assert results.aligned[0, 0] == aligned


def test_a_kart_has_parked_after_a_second_in_place_and_not_before():
    world = world_of(lot_of(IN_PLACE))
    drive(world, REST, 9)
    assert outcome(world) == Outcome.RUNNING
    drive(world, REST, 1)
    assert outcome(world) == Outcome.PARKED
    assert world.results().time_s[0, 0] == pytest.approx(1.0)


@pytest.mark.parametrize(("speed_mps", "ended"), [(1.0 / 0.9, Outcome.STRAYED), (1.0 / 1.1, Outcome.PARKED)])
def test_a_kart_that_rolls_through_its_spot_in_less_than_a_second_has_not_parked(speed_mps, ended):
    """The way within 0.5 m is 1 m long: 0.9 s and 1.1 s. Rolling resistance takes 0.15 m/s in a second."""
    rules = Rules(farthest_m=0.6)
    start = Pose(x_m=0.0, y_m=-0.51, heading_rad=NORTH)
    world = moving(world_of(lot_of(start), rules), speed_mps + 0.08)
    assert outcome(drive(world, ROLL)) == ended


def test_the_judge_waits_until_the_kart_stands():
    world = moving(world_of(lot_of(IN_PLACE.model_copy(update={"y_m": -0.4}))), 0.5)
    drive(world, ROLL, 11)
    assert outcome(world) == Outcome.RUNNING
    assert outcome(drive(world, REST)) == Outcome.PARKED


def test_a_break_of_the_dwell_begins_it_anew():
    world = world_of(lot_of(IN_PLACE))
    drive(world, REST, 8)
    world.view(0).karts[0, kart.X] = 0.6
    drive(world, REST, 1)
    world.view(0).karts[0, kart.X] = 0.0
    drive(world, REST, 9)
    assert outcome(world) == Outcome.RUNNING
    assert outcome(drive(world, REST, 1)) == Outcome.PARKED


def far(distance_m: float = 20.0) -> Pose:
    return Pose(x_m=0.0, y_m=-distance_m, heading_rad=NORTH)


@pytest.mark.parametrize(
    ("rules", "start", "action", "ended", "reward"),
    [
        (SIMPLE, IN_PLACE, REST, Outcome.PARKED, 1.0),
        (SIMPLE, far(30.5), REST, Outcome.STRAYED, -1.0),
        (SIMPLE, far(29.5), REST, Outcome.RUNNING, 0.0),
        (ALIGNED, IN_PLACE, REST, Outcome.RUNNING, 0.0),
        (ALIGNED, far(), np.array([-0.01, 0.0, 0.0]), Outcome.REVERSED, -1.0),
        (JUDGED, far(), np.array([-0.01, 0.0, 0.0]), Outcome.RUNNING, 0.0),
        (ALIGNED, IN_PLACE.model_copy(update={"heading_rad": NORTH + 0.18}), REST, Outcome.MISALIGNED, -1.0),
        (ALIGNED, IN_PLACE.model_copy(update={"heading_rad": NORTH + 0.17}), REST, Outcome.RUNNING, 0.0),
        (ALIGNED, IN_PLACE, np.array([0.0, 1.0, 1.0]), Outcome.MISALIGNED, -1.0),
        (ALIGNED, far(), np.array([0.0, 1.0, 1.0]), Outcome.RUNNING, 0.0),
        (WITHOUT_DWELL, IN_PLACE, REST, Outcome.PARKED, 1.0),
        (LITERAL, IN_PLACE, REST, Outcome.RUNNING, 0.0),
    ],
)
def test_each_rule_ends_an_episode_with_its_reward(rules, start, action, ended, reward):
    world = world_of(lot_of(start), rules)
    for _ in range(4):
        given = float(world.step(np.broadcast_to(action, (1, 1, 3)))[0, 0])
        if not world.running.any():
            break
    assert (outcome(world), given) == (ended, reward)


def test_the_literal_reading_needs_a_second_since_the_beginning_and_no_dwell():
    world = moving(world_of(lot_of(Pose(x_m=0.0, y_m=-2.0, heading_rad=NORTH)), LITERAL), 1.6)
    drive(world, ROLL)
    assert outcome(world) == Outcome.PARKED
    assert world.results().time_s[0, 0] == pytest.approx(1.0, abs=0.11)


def test_the_time_limit_ends_with_minus_one():
    world = world_of(lot_of(far(), time_limit_s=0.5))
    rewards = [float(world.step(np.broadcast_to(REST, (1, 1, 3)))[0, 0]) for _ in range(6)]
    assert rewards == [0, 0, 0, 0, -1, 0]
    assert outcome(world) == Outcome.TIMED_OUT


def test_progress_is_paid_per_metre_and_taken_back():
    world = moving(world_of(lot_of(far()), Rules(progress=0.5)), 2.0)
    gained = sum(float(world.step(np.broadcast_to(ROLL, (1, 1, 3)))[0, 0]) for _ in range(10))
    assert gained == pytest.approx(0.5 * float(world.results().driven_m[0, 0]), rel=1e-6)


@pytest.mark.parametrize(
    ("degrees", "sideways_m", "bonus"),
    [(0.0, 0.0, 2.0), (3.0, 0.0, 2.0 / math.e), (-3.0, 0.0, 2.0 / math.e), (0.0, 0.2, 2.0 / math.e), (9.0, 0.0, 0.0)],
)
def test_a_parked_kart_is_paid_for_its_alignment(degrees, sideways_m, bonus):
    pose = Pose(x_m=sideways_m, y_m=0.1, heading_rad=NORTH + math.radians(degrees))
    world = world_of(lot_of(pose), Rules(seconds="none", alignment=2.0))
    assert float(world.step(np.broadcast_to(REST, (1, 1, 3)))[0, 0]) == pytest.approx(1.0 + bonus, abs=1e-3)


@pytest.mark.parametrize(
    ("rest", "kind"),
    [
        ({"walls": (Wall(x0_m=-3, y0_m=-10, x1_m=3, y1_m=-10),)}, Kind.WALL),
        ({"cars": (ParkedCar(x_m=0, y_m=-8, heading_rad=0.3, length_m=4, width_m=1.8),)}, Kind.CAR),
        ({"pedestrians": (Pedestrian(x0_m=0, y0_m=-10, x1_m=0, y1_m=-10, speed_mps=0),)}, Kind.PEDESTRIAN),
    ],
)
def test_contact_ends_the_episode_and_says_with_what(rest, kind):
    world = moving(world_of(lot_of(far(), **rest)), 3.0)
    drive(world, np.array([0.5, 0.0, -1.0]), 100)
    assert outcome(world) == Outcome.COLLIDED
    assert world.results().touched[0, 0] == kind


def test_a_pedestrian_waits_for_a_standing_kart_and_walks_on_when_it_is_gone():
    walker = Pedestrian(x0_m=-4.0, y0_m=-20.0, x1_m=4.0, y1_m=-20.0, speed_mps=1.0)
    world = world_of(lot_of(far(), pedestrians=(walker,)))
    drive(world, REST, 40)
    assert outcome(world) == Outcome.RUNNING
    waits_at = float(world.view(0).walkers[0, 7])
    assert -2.0 < waits_at < -kart.WIDTH_M / 2 - 0.3
    world.view(0).karts[0, kart.Y] = -10.0
    drive(world, REST, 20)
    assert world.view(0).walkers[0, 7] == pytest.approx(waits_at + 2.0, abs=0.01)


def test_a_pedestrian_that_waited_for_two_seconds_turns_back():
    walker = Pedestrian(x0_m=-4.0, y0_m=-20.0, x1_m=4.0, y1_m=-20.0, speed_mps=1.0)
    world = world_of(lot_of(far(), pedestrians=(walker,)))
    drive(world, REST, 40)
    waited_at = float(world.view(0).walkers[0, 7])
    drive(world, REST, 20)
    assert -4.0 < world.view(0).walkers[0, 7] < waited_at - 0.5
    assert outcome(world) == Outcome.RUNNING


def test_two_karts_that_meet_have_both_collided():
    west, east = Pose(x_m=-3.0, y_m=-10.0), Pose(x_m=3.0, y_m=-10.0, heading_rad=math.pi)
    world = moving(moving(world_of(lot_of(west, east)), 2.0, 0), 2.0, 1)
    drive(world, ROLL, 20)
    assert [outcome(world, 0), outcome(world, 1)] == [Outcome.COLLIDED, Outcome.COLLIDED]
    assert (world.results().touched == Kind.KART).all()


def test_a_kart_whose_spot_is_taken_heads_for_the_next_free_one():
    spots = tuple(SPOT.model_copy(update={"x_m": x}) for x in (0.0, 6.0, 12.0))
    car = ParkedCar(x_m=6.0, y_m=0.0, heading_rad=NORTH, length_m=4.0, width_m=1.8)
    first = Pose(x_m=0.0, y_m=-2.6, heading_rad=NORTH)
    second, third = Pose(x_m=-3.0, y_m=-8.0, heading_rad=NORTH), Pose(x_m=13.0, y_m=-8.0, heading_rad=NORTH)
    world = moving(world_of(lot_of(first, second, third, spots=spots, cars=(car,))), 1.5)
    assert world.view(0).counts[:, TARGET].tolist() == [0, 0, 2]
    drive(world, ROLL, 2)
    assert world.view(0).counts[:, TARGET].tolist() == [0, 2, 2]  # the middle spot has a car in it
    drive(world, ROLL, 12)
    drive(world, REST, 20)
    assert outcome(world, 0) == Outcome.PARKED
    assert world.running.tolist() == [[False, True, True]]


def test_a_kart_never_heads_for_a_spot_in_which_a_car_stands():
    """The one free spot has another kart in it at the beginning; the kart waits for it, also when it is left."""
    spots = tuple(SPOT.model_copy(update={"x_m": x}) for x in (0.0, 6.0))
    car = ParkedCar(x_m=0.0, y_m=0.0, heading_rad=NORTH, length_m=4.0, width_m=1.8)
    leaving, waiting = Pose(x_m=6.0, y_m=-1.0, heading_rad=-NORTH), Pose(x_m=-4.0, y_m=-8.0)
    world = moving(world_of(lot_of(leaving, waiting, spots=spots, cars=(car,))), 3.0)
    assert world.view(0).counts[:, TARGET].tolist() == [1, 1]
    drive(world, ROLL, 20)
    assert world.view(0).karts[0, kart.Y] < -3.0
    assert world.view(0).counts[:, TARGET].tolist() == [1, 1]


def test_a_parked_kart_stays_and_is_an_obstacle():
    spots = (SPOT, SPOT.model_copy(update={"x_m": 20.0}))
    world = world_of(lot_of(IN_PLACE, Pose(x_m=0.0, y_m=-6.0, heading_rad=NORTH), spots=spots))
    drive(world, REST, 10)
    assert outcome(world, 0) == Outcome.PARKED
    drive(world, np.array([0.5, 0.0, -1.0]), 60)
    assert [outcome(world, 0), outcome(world, 1)] == [Outcome.PARKED, Outcome.COLLIDED]


def test_a_world_of_many_lots_drives_each_as_alone():
    seeds, actions = [3, 4, 5], np.random.default_rng(0).uniform(-1, 1, (60, 3, 3))
    actions[..., 0] = 0.6
    together = ParkingWorld(3)
    together.draw([0, 1, 2], seeds, Scene.PEDESTRIANS)
    alone = [ParkingWorld(1) for _ in seeds]
    for world, seed in zip(alone, seeds, strict=True):
        world.draw([0], [seed], Scene.PEDESTRIANS)
    for action in actions:
        rewards = together.step(action[:, None]).copy()
        for lot, world in enumerate(alone):
            assert world.step(action[lot, None, None])[0, 0] == rewards[lot, 0]
            assert np.array_equal(world.observations[0], together.observations[lot])


def test_a_lot_begins_anew_alone_and_as_before():
    world = ParkingWorld(2, 3)
    world.draw([0, 1], [1, 2], Scene.COMPLEX)
    first = world.observations.copy()
    for _ in range(5):
        world.step(np.full((2, 3, 3), 0.5))
    kept = world.observations[0].copy()
    world.draw([1], [2], Scene.COMPLEX)
    assert np.array_equal(world.observations[0], kept)
    assert np.array_equal(world.observations[1], first[1])


def test_a_lot_with_more_karts_than_the_world_is_refused():
    with pytest.raises(InvalidInputError, match="at most 1 karts, got 2"):
        ParkingWorld(1).place(0, lot_of(IN_PLACE, far()))
    with pytest.raises(InvalidInputError, match="at least one lot and one kart"):
        ParkingWorld(0)


@pytest.mark.parametrize("karts", [9, 30, 60])
def test_more_karts_than_a_lot_holds_are_refused(karts):
    with pytest.raises(InvalidInputError, match=f"^expected at most 8 karts in a lot, got {karts}$"):
        ParkingWorld(1, karts)


def box(**rest) -> dict[str, float]:
    return {"x_m": 0.0, "y_m": 0.0, "heading_rad": NORTH, "length_m": 5.0, "width_m": 2.5, **rest}


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"spots": []}, "no spot is free"),
        ({"cars": [box()]}, "no spot is free: parked cars, blocks or walls are in all 1 spots"),
        ({"walls": [{"x0_m": -5, "y0_m": 0, "x1_m": 5, "y1_m": 0}]}, "no spot is free"),
        (
            {"spots": [box(), box(x_m=5.0, width_m=1.3)]},
            r"spot 1, at .* expected room .*, 1.85 x 1.35 m, got 5 x 1.3 m",
        ),
        ({"spots": [box(length_m=1.8)]}, "spot 0, at .* got 1.8 x 2.5 m"),
        ({"spots": [box(x_m=161.0)]}, "less than or equal to 160"),
        ({"spots": [box(), box(x_m=2.0)]}, r"spots 0 and 1 overlap, at \(0.00, 0.00\) m, 90 degrees"),
        ({"cars": [box(x_m=10.0)]}, "kart 0 starts in parked car 0, at"),
        ({"blocks": [box(x_m=10.0)]}, "kart 0 starts in block 0, at"),
        ({"walls": [{"x0_m": 9, "y0_m": -9, "x1_m": 11, "y1_m": 9}]}, "kart 0 starts in wall 0, at"),
        ({"pedestrians": [{"x0_m": 10.9, "y0_m": 0, "x1_m": 0, "y1_m": 0}]}, "kart 0 starts in pedestrian 0, at"),
        ({"karts": [{"x_m": 10, "y_m": 0}, {"x_m": 11, "y_m": 0}]}, "kart 1 starts in kart 0, at"),
        ({"karts": []}, "at least 1 item"),
        ({"time_limit_s": 0.04}, "greater than or equal to 0.1"),
    ],
)
def test_a_lot_that_cannot_be_driven_is_refused_with_one_error(given, said):
    sound = {"spots": [box()], "karts": [{"x_m": 10.0, "y_m": 0.0, "heading_rad": NORTH}]}
    assert Lot.model_validate(sound)
    with pytest.raises(ValueError, match=said) as caught:
        Lot.model_validate({**sound, **given})
    assert len(caught.value.errors()) == 1


def test_a_wall_along_the_edge_of_a_spot_leaves_it_free_and_one_through_it_does_not():
    spots = tuple(Spot(**box(x_m=x)) for x in (0.0, 5.0))
    edge, inside = (Wall(x0_m=x, y0_m=-3.0, x1_m=x, y1_m=3.0) for x in (1.25 - 0.09, 5.0 + 1.25 - 0.11))
    assert lot_of(far(), spots=spots, walls=(edge,)).free_spots == (0, 1)
    assert lot_of(far(), spots=spots, walls=(edge, inside)).free_spots == (0,)


def test_the_farthest_spot_is_where_the_observation_says():
    world = world_of(lot_of(far(), spots=(Spot(**box(x_m=-160.0, y_m=160.0)),), time_limit_s=0.1))
    assert (80 * world.observations[0, 0, 6:8]).tolist() == [-160.0, 160.0]
    drive(world)
    assert world.results().time_s[0, 0] == pytest.approx(0.1)


def test_spots_side_by_side_do_not_overlap():
    spots = [Spot(**box(x_m=2.5 * number)) for number in range(3)]
    assert lot_of(far(), spots=tuple(spots)).free_spots == (0, 1, 2)
