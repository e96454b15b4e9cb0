from __future__ import annotations

import heapq
import math
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.networks.catalog import load_network
from dohyo.sumo_networks.networks.network import RoadNetwork
from dohyo.sumo_networks.routes.command import Command
from dohyo.sumo_networks.routes.route import COMMAND_LEAD_M, Route
from dohyo.sumo_networks.routes.routing import (
    LANE_CHANGE_COST_S,
    MIN_LANE_CHANGE_M,
    SHORT_LANE_CHANGE_COST_S,
    TURNAROUND_COST_S,
    _search,
    plan_route,
)
from dohyo.sumo_networks.scenario import Mission, Place
from tests.worlds import crossing_for_pedestrians, lit_crossing, straight_road

CITIES = ("ingolstadt", "adlershof")


def mission(start: str, goal: str, start_m: float = 0.0, goal_m: float = -1.0, via: tuple[str, ...] = ()) -> Mission:
    return Mission(start=Place(lane=start, position_m=start_m), goal=Place(lane=goal, position_m=goal_m), via=via)


@cache
def random_drives(city: str, count: int = 40) -> list[tuple[Mission, Route]]:
    """Random missions that can be driven, and their routes."""
    network, rng = load_network(city), np.random.default_rng(3)
    lanes = np.flatnonzero(network.lanes.drivable & ~network.lanes.internal)
    drives: list[tuple[Mission, Route]] = []
    while len(drives) < count:
        a, b = (int(lane) for lane in rng.choice(lanes, 2))
        at = rng.uniform(0.0, network.lanes.length[[a, b]])
        one = mission(str(network.lanes.ids[a]), str(network.lanes.ids[b]), float(at[0]), float(at[1]))
        try:
            drives.append((one, plan_route(network, one)))
        except InvalidInputError:
            continue
    return drives


# The path


@pytest.mark.parametrize("city", CITIES)
def test_path_points_are_a_metre_apart(city: str) -> None:
    for _, route in random_drives(city):
        gaps = np.hypot(*np.diff(route.position, axis=0).T)
        # Where the net itself has a kink, the chord cuts the corner.
        assert gaps.max() < 1.05
        assert gaps.min() > 0.6
        assert np.median(gaps) == pytest.approx(1.0, abs=0.05)
        assert gaps.sum() == pytest.approx(route.length)


def test_in_a_smooth_bend_the_spacing_is_even() -> None:
    gaps = np.hypot(*np.diff(plan_route(lit_crossing().network, mission("w_c_1", "c_n_1")).position, axis=0).T)
    assert gaps.max() - gaps.min() < 0.002


@pytest.mark.parametrize("city", CITIES)
def test_the_path_leads_from_the_start_to_the_goal(city: str) -> None:
    network = load_network(city)
    for one, route in random_drives(city):
        for place, row in ((one.start, 0), (one.goal, -1)):
            lane = network.lane_index[place.lane]
            assert route.position[row] == pytest.approx(network.lane_point(lane, place.position_m)[:2], abs=1e-6)
            assert route.lane[row] == lane


@pytest.mark.parametrize("city", CITIES)
def test_the_heading_is_that_of_the_path_and_never_jumps(city: str) -> None:
    for _, route in random_drives(city):
        steps = np.diff(route.position, axis=0)
        travelled = np.arctan2(steps[:, 1], steps[:, 0])
        assert np.abs(np.diff(np.unwrap(route.heading))).max() < math.pi / 2
        away = (route.heading[:-1] - travelled + math.pi) % (2 * math.pi) - math.pi
        assert np.quantile(np.abs(away), 0.9) < 0.2
        # Curvature is the rate at which the heading turns: over the path both turn as far.
        turned = np.unwrap(route.heading)[-1] - route.heading[0]
        assert np.trapezoid(route.curvature, dx=route.length / len(steps)) == pytest.approx(turned, abs=0.3)


@pytest.mark.parametrize("city", CITIES)
def test_the_path_keeps_to_its_lanes_but_for_lane_changes(city: str) -> None:
    network = load_network(city)
    for _, route in random_drives(city, 15):
        spacing = route.length / (len(route.position) - 1)
        for i in range(0, len(route.position), 3):
            s = i * spacing
            if any(change.start - 3 < s < change.end + 3 for change in route.lane_changes):
                continue
            x, y = route.position[i]
            lane, offset, _ = network.nearest_lane(float(x), float(y), float(route.heading[i]), route.on_route)
            assert route.on_route[lane]
            assert abs(offset) < 1.0


@pytest.mark.parametrize("city", CITIES)
def test_every_lane_on_the_path_follows_the_one_before(city: str) -> None:
    network = load_network(city)

    def follows(a: int, b: int, depth: int = 4) -> bool:
        """Whether b is beside a or comes after it, but for lanes so short that no point of the path lies on them."""
        if b in (network.lanes.left[a], network.lanes.right[a]):
            return True
        onward = [int(network.connections.target[c]) for c in network.connections_from(a)]
        short = [lane for lane in onward if network.lanes.length[lane] < 2.0 and depth]
        return b in onward or any(follows(lane, b, depth - 1) for lane in short)

    for _, route in random_drives(city):
        assert network.lanes.drivable[route.lane].all()
        assert route.on_route[route.lane].all()
        for a, b in pairwise(route.lane):
            assert a == b or follows(int(a), int(b)), (network.lanes.ids[a], network.lanes.ids[b])


@pytest.mark.parametrize("city", CITIES)
def test_the_route_knows_the_limits_and_widths_of_its_lanes(city: str) -> None:
    network = load_network(city)
    for _, route in random_drives(city):
        np.testing.assert_array_equal(route.speed_limit, network.lanes.speed[route.lane])
        np.testing.assert_array_equal(route.width, network.lanes.width[route.lane])


@pytest.mark.parametrize("city", CITIES)
def test_junctions_come_in_order_at_the_ends_of_their_lanes(city: str) -> None:
    network = load_network(city)
    connections = network.connections
    ahead_of_line = []
    for _, route in random_drives(city):
        spacing = route.length / (len(route.position) - 1)
        for passage in route.passages:
            assert 0 <= passage.entry <= passage.exit <= route.length + 1e-6
            before, end = network.lane_shape(int(connections.source[passage.connection]))[-2:]
            i = min(int(passage.entry / spacing), len(route.position) - 2)
            step = route.position[i + 1] - route.position[i]
            entry = route.position[i] + (passage.entry / spacing - i) * step
            ahead_of_line.append(float((entry - end) @ (end - before) / np.hypot(*(end - before))))
            assert passage.signal == connections.signal[passage.connection]
            assert passage.control == connections.control[passage.connection]
        for one, following in pairwise(route.passages):
            assert one.exit <= following.entry + 1e-6
    # A car that stops by the route stops at the line; only at a kink of the net the smooth path passes it elsewhere.
    assert np.quantile(np.abs(ahead_of_line), 0.98) < 0.25
    assert np.abs(ahead_of_line).max() < 1.5


@pytest.mark.parametrize("city", CITIES)
def test_sumo_edges_of_the_route_are_connected(city: str) -> None:
    network = load_network(city)
    for one, route in random_drives(city):
        assert route.edges[0] == network.edge_id(network.lane_index[one.start.lane])
        assert route.edges[-1] == network.edge_id(network.lane_index[one.goal.lane])
        assert not any(edge.startswith(":") for edge in route.edges)
        assert len(route.edges) == len(route.passages) + 1


# Projection


@given(st.sampled_from(CITIES), st.integers(0, 39), st.floats(0.02, 0.98), st.floats(-1.5, 1.5))
def test_projection_gives_back_arc_length_and_offset(city: str, drive: int, share: float, offset: float) -> None:
    _, route = random_drives(city)[drive]
    last = len(route.position) - 1
    at = share * last
    i = min(int(at), last - 1)
    assume(np.abs(route.curvature[max(i - 4, 0) : i + 6]).max() < 0.1)
    along = (route.position[i + 1] - route.position[i]) * last / route.length
    left = np.array([-along[1], along[0]])
    x, y = route.position[i] + (at - i) * along * route.length / last + offset * left
    s, found, direction = route.project(float(x), float(y), at * route.length / last)
    assert s == pytest.approx(at * route.length / last, abs=0.2)
    assert found == pytest.approx(offset, abs=0.05)
    assert math.cos(direction - math.atan2(along[1], along[0])) > 0.98


def test_left_of_the_route_is_positive() -> None:
    route = straight_road().route
    assert route.project(100.0, -3.8, 100.0) == pytest.approx((100.0, 1.0, 0.0))
    assert route.project(100.0, -5.8, 100.0) == pytest.approx((100.0, -1.0, 0.0))


@pytest.mark.parametrize(("near", "expected"), [(500.0, 500.0), (485.0, 500.0), (400.0, 430.0), (600.0, 590.0)])
def test_projection_cannot_leap(near: float, expected: float) -> None:
    s, _, _ = straight_road().route.project(500.0, -4.8, near)
    assert s == pytest.approx(expected, abs=1.5)


# Commands


def test_the_command_says_left_from_30_metres_before_the_junction_to_its_end() -> None:
    network = lit_crossing().network
    route = plan_route(network, mission("w_c_1", "c_n_1"))
    (passage,) = route.passages
    assert passage.command is Command.LEFT
    assert network.connections.direction[passage.connection] == "l"
    assert passage.signal >= 0
    assert passage.entry == pytest.approx(lit_crossing().stop_line("w_c_1") + 200.0, abs=1.0)
    begin, end = passage.entry - COMMAND_LEAD_M, passage.exit
    for i, command in enumerate(route.command):
        s = i * route.length / (len(route.position) - 1)
        if abs(s - begin) > 1 and abs(s - end) > 1:
            assert command == (Command.LEFT if begin < s < end else Command.FOLLOW), s
    turned = route.heading[-1] - route.heading[0]
    assert turned == pytest.approx(math.pi / 2, abs=0.05)
    assert route.curvature.max() > 0.05


@pytest.mark.parametrize(("goal", "command"), [("c_s_0", Command.RIGHT), ("c_e_0", Command.STRAIGHT)])
def test_the_command_names_the_turn(goal: str, command: Command) -> None:
    route = plan_route(lit_crossing().network, mission("w_c_0", goal))
    assert [passage.command for passage in route.passages] == [command]
    assert command in route.command


def test_a_lane_change_is_announced_and_smooth() -> None:
    route = plan_route(straight_road().network, mission("w_e_0", "w_e_1"))
    (change,) = route.lane_changes
    assert change.command is Command.CHANGE_LEFT
    y = route.position[:, 1]
    s = np.linspace(0, route.length, len(y))
    np.testing.assert_allclose(y[s < change.start - 3], -4.8, atol=0.01)
    np.testing.assert_allclose(y[s > change.end + 3], -1.6, atol=0.01)
    assert (np.diff(y) > -1e-9).all()
    assert 25 < change.end - change.start < 40
    assert np.abs(route.curvature).max() < 0.03
    assert (route.command[(s > change.start - 29) & (s < change.end - 1)] == Command.CHANGE_LEFT).all()
    assert (route.command[s < change.start - 31] == Command.FOLLOW).all()
    assert route.passages == ()


def test_the_way_back_to_the_right_is_a_change_to_the_right() -> None:
    route = plan_route(straight_road().network, mission("w_e_1", "w_e_0"))
    assert [change.command for change in route.lane_changes] == [Command.CHANGE_RIGHT]


def test_the_lane_is_changed_where_there_is_room_before_the_goal() -> None:
    # 3 m behind the junction there is no room any more; before it there is.
    route = plan_route(lit_crossing().network, mission("w_c_1", "c_e_0", goal_m=3.0))
    (change,) = route.lane_changes
    assert change.end < route.passages[0].entry


def test_even_without_any_room_the_path_is_finite() -> None:
    route = plan_route(straight_road().network, mission("w_e_0", "w_e_1", start_m=500.0, goal_m=500.0))
    assert np.isfinite(route.position).all()
    assert np.isfinite(route.heading).all()


# The search


def cheapest(network: RoadNetwork, start: int, start_at: float, goal: int, goal_at: float) -> float:
    """Dijkstra's answer, s: no heuristic, every lane looked at."""
    lanes, connections = network.lanes, network.connections
    done: set[tuple[int, float]] = set()
    frontier = [(0.0, start, start_at)]
    while frontier:
        cost, lane, at = heapq.heappop(frontier)
        if (lane, at) in done:
            continue
        done.add((lane, at))
        if lane == goal and at <= goal_at:
            return cost
        for c in network.connections_from(lane):
            if lanes.drivable[connections.target[c]]:
                turn = TURNAROUND_COST_S if connections.direction[c] == "t" else 0.0
                through = cost + (lanes.length[lane] - at) / lanes.speed[lane] + turn
                heapq.heappush(frontier, (through, int(connections.target[c]), 0.0))
        for beside in (int(lanes.left[lane]), int(lanes.right[lane])):
            if beside >= 0:
                heapq.heappush(frontier, (cost + change_cost(network, lane, at, goal, goal_at), beside, at))
    return math.inf


def change_cost(network: RoadNetwork, lane: int, at: float, goal: int, goal_at: float) -> float:
    end = float(network.lanes.length[lane])
    if network.edge_id(lane) == network.edge_id(goal) and at <= goal_at:
        end = min(end, goal_at)
    return LANE_CHANGE_COST_S if end - at >= MIN_LANE_CHANGE_M else SHORT_LANE_CHANGE_COST_S


def cost_of(network: RoadNetwork, way: list[int], at: float, goal_at: float) -> float:
    lanes, connections, total = network.lanes, network.connections, 0.0
    for a, b in pairwise(way):
        onward = {int(connections.target[c]): str(connections.direction[c]) for c in network.connections_from(a)}
        if b in onward:
            total += (lanes.length[a] - at) / lanes.speed[a] + TURNAROUND_COST_S * (onward[b] == "t")
            at = 0.0
        else:
            total += change_cost(network, a, at, way[-1], goal_at)
    return total


@pytest.mark.parametrize(("city", "count"), [("ingolstadt", 100), ("adlershof", 60), ("crossing", 60)])
def test_no_way_is_cheaper_than_the_one_found(city: str, count: int) -> None:
    network = lit_crossing().network if city == "crossing" else load_network(city)
    rng, found = np.random.default_rng(0), 0
    lanes = np.flatnonzero(network.lanes.drivable & ~network.lanes.internal)
    for _ in range(count):
        start, goal = (int(lane) for lane in rng.choice(lanes, 2))
        start_at, goal_at = (float(rng.uniform(0, network.lanes.length[lane])) for lane in (start, goal))
        way, best = (
            _search(network, start, start_at, goal, goal_at, []),
            cheapest(network, start, start_at, goal, goal_at),
        )
        assert (way is None) == math.isinf(best)
        if way is not None:
            found += 1
            assert (way[0], way[-1]) == (start, goal)
            assert cost_of(network, way, start_at, goal_at) == pytest.approx(best)
    assert found > count / 10


def test_a_goal_behind_the_start_on_the_same_lane_takes_the_way_round() -> None:
    network = load_network("adlershof")
    one, route = next((m, r) for m, r in random_drives("adlershof") if network.lanes.length[r.lane[0]] > 40)
    back = plan_route(network, mission(one.start.lane, one.start.lane, start_m=35.0, goal_m=5.0))
    ahead = plan_route(network, mission(one.start.lane, one.start.lane, start_m=5.0, goal_m=35.0))
    assert ahead.length == pytest.approx(30.0, rel=0.1)
    assert ahead.passages == ()
    assert back.length > 60.0
    assert back.passages
    assert route.length > 0


@pytest.mark.parametrize("city", CITIES)
def test_via_an_edge_on_its_way_changes_nothing(city: str) -> None:
    network = load_network(city)
    for one, route in random_drives(city):
        through = plan_route(network, one.model_copy(update={"via": route.edges[1::3]}))
        np.testing.assert_array_equal(through.position, route.position)


def test_via_edges_are_passed_in_order() -> None:
    network, rng = load_network("adlershof"), np.random.default_rng(1)
    edges = sorted({edge for _, route in random_drives("adlershof") for edge in route.edges})
    detours = 0
    for one, route in random_drives("adlershof", 20):
        via = tuple(str(edge) for edge in rng.choice(edges, 2))
        try:
            through = plan_route(network, one.model_copy(update={"via": via}))
        except InvalidInputError:
            continue
        rest = iter(through.edges)
        assert all(edge in rest for edge in via)
        assert through.length >= route.length - 50
        detours += through.length > route.length + 1
    assert detours > 10


# Missions that cannot be driven


@pytest.mark.parametrize(
    ("scene", "bad", "message"),
    [
        pytest.param(straight_road, mission("w_e_9", "w_e_0"), "no lane 'w_e_9'.*start", id="unknown start"),
        pytest.param(straight_road, mission("w_e_0", "w_e_9"), "no lane 'w_e_9'.*goal", id="unknown goal"),
        pytest.param(straight_road, mission("w_e_0", "e_w_0"), "no lane-level route .*'e_w_0'", id="unreachable goal"),
        pytest.param(
            straight_road, mission("w_e_0", "w_e_0", 500.0, 100.0), "no lane-level route", id="goal behind the start"
        ),
        pytest.param(straight_road, mission("w_e_0", "w_e_0", 1000.5), "at 1000.5 m is off lane 'w_e_0'", id="past it"),
        pytest.param(
            straight_road, mission("w_e_0", "w_e_0", 0.0, -1000.5), "at -1000.5 m is off lane", id="before it"
        ),
        pytest.param(straight_road, mission("w_e_0", "w_e_0", 10.0, 11.5), "less than 2 m apart", id="too short"),
        pytest.param(straight_road, mission("w_e_0", "w_e_0", via=("x",)), "no drivable edge 'x'", id="unknown via"),
        pytest.param(
            straight_road, mission("w_e_0", "w_e_0", via=("e_w",)), "no lane-level route .*via e_w", id="lost via"
        ),
        pytest.param(
            crossing_for_pedestrians, mission("w_c_0", "c_e_1"), "'w_c_0' is closed to passenger cars", id="sidewalk"
        ),
    ],
)
def test_a_mission_that_cannot_be_driven_is_refused(scene, bad: Mission, message: str) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(InvalidInputError, match=rf"mission 'ego': .*{message}"):
        plan_route(scene().network, bad)
