"""Facts: what hand-made scenes say."""

from __future__ import annotations

import math

import numpy as np
import pytest

from dohyo.agents.planning.sidestep import Sidestep
from dohyo.agents.planning.surroundings import Surroundings
from dohyo.agents.rules.facts import SENSORS, FactsBuilder, Memory, Moment, tenths, travel_time
from dohyo.agents.rules.rulebook import read_rulebook
from dohyo.agents.rules.rules_only import RULES
from dohyo.agents.rules.solver import Solver
from dohyo.agents.safety.rss_monitor import Danger
from dohyo.sumo_networks.sensors import make_sensors
from dohyo.sumo_networks.world import ActorKind, LightState, World
from tests.worlds import Scene, crossing_for_pedestrians, lit_crossing, stop_sign_crossing, straight_road

WEST, NORTH, SOUTH = math.pi, math.pi / 2, -math.pi / 2


def seen(world: World) -> dict[str, np.ndarray]:
    return {sensor.name: sensor.read(world, 0) for sensor in make_sensors(SENSORS)}


def moment(scene: Scene, seconds: float = 0.0, dangers: tuple[Danger, ...] = (), offset: float = 0.0) -> Moment:
    """The facts at the end of a scene that was watched from its start."""
    memory, aside, builder = Memory(), Sidestep(), FactsBuilder()
    if offset:
        aside.lead(offset, -100.0, 1.0)
    for world in scene.worlds(seconds):
        observation = seen(world)
        around = Surroundings(observation)
        memory.watch(observation, around.neighbours)
        out = builder.moment(observation, around, memory, aside, dangers, advised=12.0)
    return out


def said(scene: Scene, name: str, seconds: float = 0.0, **more: float) -> list[str]:
    return [str(fact) for fact in moment(scene, seconds, **more).facts if fact.name == name]  # type: ignore[arg-type]


def numbers(scene: Scene, name: str, seconds: float = 0.0) -> list[list[object]]:
    """Arguments of all facts of a name."""
    return [list(one.arguments) for one in moment(scene, seconds).facts if one.name == name]


def ego(speed: float = 8.0) -> Scene:
    return straight_road().with_ego(x=100.0, speed=speed)


def test_numbers_are_whole_tenths_rounded_down() -> None:
    assert [tenths(v) for v in (0.0, 8.34, -0.05, 5000.0)] == [0, 83, -1, 10000]


def test_an_empty_road_says_little() -> None:
    facts = {fact.name for fact in moment(ego()).facts}
    assert facts == {"speed", "advised", "standing", "refused", "sight"}
    assert said(ego(), "speed") == ["speed(80)"]
    assert said(ego(), "sight") == ["sight(1790)"]


# The road


def test_junctions_say_where_they_are_and_what_their_light_shows() -> None:
    scene = lit_crossing().with_ego(x=-60.0, speed=8.0)
    ((junction, entry, leave),) = numbers(scene, "junction")
    front = scene.stop_line("w_c_0") - (-60.0 + 2.25)
    assert junction == 1
    assert entry == pytest.approx(front * 10.0, abs=12)
    assert isinstance(leave, int)
    assert leave > entry
    for state, name in ((LightState.RED, "red"), (LightState.YELLOW, "yellow"), (LightState.GREEN, "green")):
        assert said(scene.with_lights(state), "signal") == [f"signal(1,{name})"]
    assert said(scene.with_lights(LightState.OFF), "signal") == []


def test_a_stop_sign_is_known_and_that_the_ego_has_stood_there() -> None:
    line = stop_sign_crossing().stop_line("w_c_0")
    driving = stop_sign_crossing().with_ego(x=line - 4.0, speed=2.0)
    standing = stop_sign_crossing().with_ego(x=line - 4.0, speed=0.0)
    assert said(driving, "sign") == ["sign(1,stop)"]
    assert said(driving, "stood_at") == []
    assert said(standing, "stood_at") == ["stood_at(1)"]
    assert said(stop_sign_crossing().with_ego(x=line - 20.0, speed=0.0), "stood_at") == []


# Who is ahead


def test_who_is_ahead_has_a_gap_and_a_speed_along_the_path() -> None:
    ((_, kind, gap, speed),) = numbers(ego().with_actor(130.0, 5.0), "ahead")
    assert (kind, speed) == ("car", 50)
    assert gap == pytest.approx(255, abs=6)


def test_who_comes_has_a_speed_below_zero() -> None:
    ((_, _, _, speed),) = numbers(ego().with_actor(130.0, 5.0, heading=WEST), "ahead")
    assert speed == -50


@pytest.mark.parametrize(("left", "expected"), [(0.0, 1), (2.0, 1), (2.2, 0), (3.2, 0), (-2.2, 0)])
def test_who_is_beside_the_strip_is_not_ahead(left: float, expected: int) -> None:
    # Half of 1.8 m each and a margin of 0.3 m: 2.1 m.
    assert len(numbers(ego().with_actor(130.0, 5.0, left=left), "ahead")) == expected


def test_on_its_way_aside_the_ego_looks_where_it_goes() -> None:
    scene = ego().with_actor(130.0, 5.0, left=3.2)
    assert said(scene, "ahead") == []
    assert len(said(scene, "ahead", offset=3.2)) == 1
    assert said(scene, "aside", offset=3.2) == ["aside(left)"]


@pytest.mark.parametrize(("own", "other", "said_of"), [(0.0, 3.0, 1), (0.0, 0.0, 0), (3.0, 3.0, 0)])
def test_a_standing_ego_waits_for_who_sweeps_across_its_front(own: float, other: float, said_of: int) -> None:
    scene = ego(own).with_actor(102.5, other, left=1.2, heading=-2.5)
    ahead = numbers(scene, "ahead")
    assert len(ahead) == said_of
    assert all(gap == 0 for _, _, gap, _ in ahead)


def test_who_stands_is_said_for_how_long_and_where_it_ends() -> None:
    scene = ego(0.0).with_actor(110.0, 0.0)
    ((_, stood),) = numbers(scene, "stood", 3.0)
    assert stood == pytest.approx(31, abs=1)
    ((_, last),) = numbers(scene, "extent")
    assert last == pytest.approx(100, abs=6)
    assert said(scene, "driven", 3.0) == []
    assert said(scene, "askew") == []
    assert len(said(ego(0.0).with_actor(110.0, 0.0, heading=0.2), "askew")) == 1


def test_who_was_seen_driving_is_remembered() -> None:
    scene = ego(0.0).with_actor(110.0, lambda t: 5.0 if t < 1.0 else 0.0)
    assert len(said(scene, "driven", 2.0)) == 1


def test_who_drifts_into_the_strip_enters_it() -> None:
    drifting = ego().with_actor(115.0, 8.0, left=2.8, drift=-0.0, heading=-0.08)
    ((_, gap, speed),) = numbers(drifting, "enters")
    assert gap == pytest.approx(105, abs=8)
    assert speed == pytest.approx(79, abs=1)
    assert numbers(ego().with_actor(115.0, 8.0, left=2.8), "enters") == []
    assert numbers(ego().with_actor(115.0, 8.0, left=2.8, heading=0.08), "enters") == []


# Who crosses


def test_paths_that_cross_say_when_each_is_there() -> None:
    scene = lit_crossing().with_ego(x=-40.0, speed=8.0).with_actor(4.8, 8.0, y=-50.0, heading=NORTH)
    ((_, kind, meets),) = numbers(scene, "meets")
    assert kind == "car"
    assert meets == pytest.approx(400, abs=40)
    ((_, arrive, clear),) = numbers(scene, "ego_at")
    ((_, first, last),) = numbers(scene, "other_at")
    assert isinstance(arrive, int)
    assert isinstance(clear, int)
    assert 40 < arrive < clear < 90
    assert isinstance(first, int)
    assert isinstance(last, int)
    assert 40 < first < last < 90
    # It comes from the right and drives to the left.
    assert len(said(scene, "from_right")) == 1
    other = lit_crossing().with_ego(x=-40.0, speed=8.0).with_actor(-4.8, 8.0, y=50.0, heading=SOUTH)
    assert said(other, "from_right") == []


def test_the_right_of_way_is_that_of_the_lights() -> None:
    scene = lit_crossing().with_ego(x=-40.0, speed=8.0).with_actor(4.8, 8.0, y=-50.0, heading=NORTH)
    ours = scene.with_lights(LightState.RED)
    (said_of,) = said(ours, "right_of_way")
    assert said_of.startswith("-")


def test_who_is_much_too_fast_races() -> None:
    scene = lit_crossing().with_ego(x=-40.0, speed=8.0)
    assert len(said(scene.with_actor(30.0, 17.0, left=6.4, heading=WEST), "races")) == 1
    assert said(scene.with_actor(30.0, 16.0, left=6.4, heading=WEST), "races") == []
    assert said(scene.with_actor(10.0, 17.0), "races") == []
    slowing = scene.with_actor(80.0, lambda t: 17.0 if t < 0.05 else 5.0, left=6.4, heading=WEST)
    assert [len(said(slowing, "races", seconds)) for seconds in (2.8, 3.4)] == [1, 0]
    assert said(scene.with_actor(-60.0, 17.0, left=6.4, heading=WEST), "races") == []


def test_who_walks_over_the_road_meets_the_ego() -> None:
    scene = crossing_for_pedestrians().with_ego(x=-40.0, speed=8.0)
    y = scene.route.position[0, 1]
    walking = scene.with_pedestrian(-20.0, 1.4, y=y - 4.0, heading=NORTH)
    assert [kind for _, kind, _ in numbers(walking, "meets")] == ["pedestrian"]
    assert numbers(scene.with_pedestrian(-20.0, 1.4, y=y - 4.0, heading=SOUTH), "meets") == []


def test_who_stands_at_the_kerb_may_cross_and_who_walks_along_does_not() -> None:
    standing = ego().with_pedestrian(120.0, 0.0, y=-4.8 - 2.0)
    along = ego().with_pedestrian(120.0, 1.4, y=-4.8 - 2.0)
    assert len(said(standing, "kerb")) == 1
    assert said(standing, "crosses") == []
    assert len(said(along, "kerb")) == 1
    assert [text[0] for text in said(along, "crosses")] == ["-"]
    assert said(ego().with_pedestrian(120.0, 0.0, y=-4.8 - 3.5), "kerb") == []


# The lanes beside


def test_lanes_are_said_where_something_may_have_to_be_passed() -> None:
    blocked = ego().with_actor(140.0, kind=ActorKind.STATIC)
    assert said(blocked, "lane") == ["lane(left,same)"]
    assert moment(blocked).lanes["left"] == pytest.approx(3.2, abs=0.1)
    assert said(ego().with_actor(140.0, 8.0), "lane") == []


def test_who_drives_in_the_lane_beside_is_said() -> None:
    scene = ego().with_actor(140.0, kind=ActorKind.STATIC).with_actor(90.0, 10.0, left=3.2)
    ((side, _, low, high, speed),) = [row for row in numbers(scene, "in_lane") if row[4] != 0]
    assert (side, speed) == ("left", 100)
    # Its rear is 14.5 m behind the ego's front, its front 5.5 m behind the ego's rear.
    assert low == pytest.approx(-145, abs=6)
    assert high == pytest.approx(-55, abs=6)


def test_a_queue_that_was_passed_hides_nobody_who_comes() -> None:
    scene = ego(0.0).with_actor(112.0, kind=ActorKind.STATIC)
    for car in range(6):
        scene = scene.with_actor(90.0 - 8.0 * car, 4.0, left=6.4, heading=WEST)
    scene = scene.with_actor(160.0, 9.0, left=6.4, heading=WEST)
    around = Surroundings(seen(scene.world()))
    ways = [one.arguments for one in FactsBuilder()._in_lane(around, "left", 6.4)]
    assert [low for _, _, low, _, _ in ways if low > 0] == [pytest.approx(555, abs=6)]
    assert [row[4] for row in ways] == [-90, -40, -40, -40], "and the nearest of those that were passed"


def test_a_full_table_of_objects_ends_the_sight() -> None:
    scene = ego()
    for i in range(48):
        scene = scene.with_actor(130.0 + 2.0 * i, 0.0, left=-8.0, length=1.0, width=1.0)
    ((sight,),) = numbers(scene, "sight")
    assert sight == pytest.approx((30 + 2 * 47) * 10, abs=15)


def test_who_comes_over_the_middle_squeezes_the_ego() -> None:
    # Its right side is 0.7 m left of the middle of the ego's lane, where the ego's left side is 0.9 m.
    squeezed = moment(ego().with_actor(150.0, 8.0, left=1.6, heading=WEST))
    assert squeezed.squeeze < -0.1
    assert "squeezed" in {fact.name for fact in squeezed.facts}
    assert moment(ego().with_actor(150.0, 8.0, left=2.4, heading=WEST)).squeeze == 0.0


# Memory


def test_waiting_is_counted_and_wears_off() -> None:
    assert numbers(ego(0.0), "standing", 2.0) == [[21]]
    assert numbers(ego(8.0), "standing", 2.0) == [[0]]


def test_the_watchs_dangers_are_facts() -> None:
    danger = Danger(key=3, gap=5.0, least_gap=8.0, side_gap=0.0, least_side_gap=0.2, braking=6.2, side=0)
    facts = [str(fact) for fact in moment(ego(), dangers=(danger,)).facts]
    assert "critical(3,62)" in facts


# What facts and rules agree on


def test_every_fact_that_a_scene_says_is_declared() -> None:
    book = Solver(read_rulebook(RULES))
    busy = (
        ego()
        .with_actor(120.0, 0.0, heading=0.1)
        .with_actor(105.0, 8.0, left=2.6, heading=-0.1)
        .with_actor(80.0, 12.0, left=3.2)
        .with_actor(200.0, 10.0, left=1.5, heading=WEST)
        .with_pedestrian(112.0, 1.4, y=-7.0, heading=NORTH)
    )
    book.decide(moment(busy).facts)
    book.decide(moment(busy, offset=3.2).facts)
    book.decide(moment(lit_crossing().with_ego(x=-30.0, speed=8.0).with_actor(4.8, 8.0, y=-30.0, heading=NORTH)).facts)


def test_travel_time_by_hand() -> None:
    assert travel_time(10.0, 10.0, 1.5, 8.0) == pytest.approx(1.0)
    assert travel_time(12.0, 0.0, 1.5, 8.0) == pytest.approx(4.0)
    assert travel_time(-3.0, 5.0, 1.5, 8.0) == 0.0
