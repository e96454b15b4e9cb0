from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numba.core.runtime import _nrt_python, rtsys

from dohyo.agents.mcts.config import ACTIONS, LATERAL_LIMIT, MIDDLE, Rules, Settings, rules
from dohyo.agents.mcts.mbappe import CRAFTED_IDM
from dohyo.agents.mcts.prior import kernel
from dohyo.agents.mcts.simulator import (
    ACCELERATION,
    CENTRING,
    COLLISION,
    DEMAND,
    FAILED,
    GAP,
    LINE,
    MEETING,
    PROGRESS,
    ROAD,
    SPEED,
    STATE,
    STEERING,
    TERMS,
    S,
    X,
    Y,
    advance,
)
from dohyo.agents.mcts.tree import (
    BEST_LEAF,
    NODES,
    PAIRS,
    Beliefs,
    Tree,
    back_up,
    make_tree,
    prior_of,
    search,
    select,
    start,
)
from dohyo.agents.planning.motion import body
from dohyo.agents.planning.situation import Situation
from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.ego.dynamics import VehicleParameters
from dohyo.sumo_networks.errors import InvalidInputError
from tests.agents.mcts.roads import ROAD_M, straight

CAR = body(VehicleParameters(), LATERAL_LIMIT)
NO_PRIOR = Settings(keeps_lane=False, prior="none", predictor="constant_velocity", first_play="zero")


def state_at(speed: float, demand: float = 0.0) -> FloatArray:
    state = np.zeros(STATE)
    state[X], state[SPEED], state[ACCELERATION], state[DEMAND] = -CAR.axle, speed, demand, demand
    return state


def beliefs(depth: int, variance: float = 100.0, last: tuple[int, int] = (MIDDLE, MIDDLE)) -> Beliefs:
    return Beliefs(
        kernel=kernel(variance),
        learned=np.full((depth, 2), -1, dtype=np.int64),
        order=np.arange(PAIRS, dtype=np.int64),
        plan=np.full(depth, -1, dtype=np.int64),
        last=np.array(last, dtype=np.int64),
        draws=np.zeros(0),
    )


def searched(
    road: Situation, given: Rules, speed: float, simulations: int, believed: Beliefs | None = None
) -> tuple[Tree, Beliefs]:
    believed = believed or beliefs(given.depth)
    tree = make_tree(simulations, given.depth)
    start(tree, road, CAR, given, CRAFTED_IDM, believed, state_at(speed))
    search(tree, road, CAR, given, CRAFTED_IDM, believed, simulations, False)
    return tree, believed


def returns(road: Situation, given: Rules, speed: float, actions: list[list[tuple[int, int]]]) -> float:
    """The best return over all sequences of actions, one list of choices per depth, without a tree."""
    best = -math.inf
    for sequence in itertools.product(*actions):
        state, total, before = state_at(speed), 0.0, MIDDLE
        for depth, (a, b) in enumerate(sequence):
            terms = np.zeros(TERMS)
            outcome = advance(road, CAR, given, state, depth * given.hold_steps, a, b, before, terms)
            total, before = total + terms.sum(), a
            if outcome == FAILED:
                break
        best = max(best, total)
    return best


def test_a_tree_larger_than_the_memory_of_the_machine_is_refused_with_its_size() -> None:
    with pytest.raises(InvalidInputError, match=r"100000000 simulations of 80 actions: .* GB of memory .* GB"):
        make_tree(100_000_000, 80)


@pytest.mark.parametrize("boxes", [[], [(14.0, 0.0, 0.0)], [(9.0, 1.0, 2.0)]])
def test_one_action_deep_the_tree_finds_what_brute_force_finds(boxes: list[tuple[float, float, float]]) -> None:
    road, given = straight(cars=boxes), rules(NO_PRIOR)._replace(depth=1, exploration=1000.0)
    tree, _ = searched(road, given, 8.0, PAIRS)
    window = range(MIDDLE - 4, MIDDLE + 5)
    assert tree.best[0] == pytest.approx(returns(road, given, 8.0, [list(itertools.product(window, window))]))


def test_two_actions_deep_with_enough_simulations_too() -> None:
    road = straight(cars=[(17.0, 0.0, 0.0)])
    given = rules(NO_PRIOR)._replace(depth=2, root_window=2, node_window=2, exploration=60.0)
    tree, _ = searched(road, given, 9.0, 800)
    best = -math.inf
    for a, b in itertools.product(range(MIDDLE - 1, MIDDLE + 2), repeat=2):
        below = list(itertools.product(range(a - 1, a + 2), range(b - 1, b + 2)))
        best = max(best, returns(road, given, 9.0, [[(a, b)], below]))
    assert tree.best[0] == pytest.approx(best)
    leaf, total = int(tree.numbers[BEST_LEAF]), 0.0
    while leaf > 0:
        total, leaf = total + tree.reward[leaf], int(tree.parent[leaf])
    assert total == pytest.approx(best)


def hand_made(q: list[float], n: list[int], p: list[float]) -> Tree:
    """A root whose first children have given Q, N and P."""
    tree = make_tree(len(q), 1)
    tree.window[0] = 0, 0, 0, len(q) - 1
    for i in range(len(q)):
        tree.child[0, i] = i + 1
        tree.value[i + 1], tree.visits[i + 1], tree.prior[i + 1] = q[i], n[i], p[i]
    tree.visits[0] = sum(n)
    return tree


@pytest.mark.parametrize(
    ("q", "n", "p", "chosen"),
    [
        # sqrt(9) = 3, c = 2: 1 + 6 x 0.5 / 6 = 1.5 against 0.5 + 6 x 0.5 / 5 = 1.1
        ([1.0, 0.5], [5, 4], [0.5, 0.5], 0),
        # sqrt(16) = 4: 1 + 8 x 0.2 / 16 = 1.1 against 0.5 + 8 x 0.8 / 2 = 3.7
        ([1.0, 0.5], [15, 1], [0.2, 0.8], 1),
        # sqrt(4) = 2: 0 + 4 x 0.9 / 3 = 1.2 against 1.21 + 4 x 0.05 / 3 > 1.2
        ([0.0, 1.21, 0.0], [2, 2, 0], [0.9, 0.05, 0.05], 1),
    ],
)
def test_selection_takes_the_highest_puct_score(q: list[float], n: list[int], p: list[float], chosen: int) -> None:
    assert select(hand_made(q, n, p), rules(NO_PRIOR), beliefs(1), 0, False) == chosen


def test_the_first_rollout_follows_the_prior_alone() -> None:
    assert select(hand_made([5.0, -5.0], [0, 0], [0.4, 0.6]), rules(NO_PRIOR), beliefs(1), 0, True) == 1


def test_puct_counts_by_hand() -> None:
    """Two actions of values 1 and 0 and equal priors: A until 2 x 0.5 x sqrt(N) (1 - 1 / (1 + n)) exceeds 1."""
    tree, given = hand_made([1.0, 0.0], [0, 0], [0.5, 0.5]), rules(NO_PRIOR)
    tree.visits[0] = 1
    order = []
    for _ in range(6):
        action = select(tree, given, beliefs(1), 0, False)
        tree.visits[action + 1] += 1
        tree.visits[0] += 1
        order.append(action)
    # N = 1: 1 + 1 > 0 + 1; N = 2: 1 + 1.41 / 2 > 1.41; N = 3: 1 + 1.73 / 3 = 1.58 < 1.73; N = 4: 1.67 > 1; ...
    assert order == [0, 0, 1, 0, 0, 0]


def test_back_up_by_hand() -> None:
    tree = make_tree(2, 2)
    tree.reward[1:4] = 1.0, 2.0, -4.0
    tree.best[:] = -math.inf
    tree.path[:3] = 0, 1, 2
    back_up(tree, 2, True)
    assert tree.value[[0, 1, 2]].tolist() == [3.0, 3.0, 2.0]
    tree.outcome[3] = FAILED
    tree.path[:3] = 0, 1, 3
    back_up(tree, 2, False)
    assert tree.value[[0, 1, 2, 3]].tolist() == [0.0, 0.0, 2.0, -4.0]
    assert tree.visits[[0, 1, 2, 3]].tolist() == [2, 2, 1, 1]
    assert tree.perfect[[0, 1, 2, 3]].tolist() == [1, 1, 1, 0]
    assert tree.numbers[BEST_LEAF] == 2
    assert tree.best[1] == 3.0


def test_visits_of_children_add_up() -> None:
    tree, _ = searched(straight(cars=[(25.0, 0.0, 3.0)]), rules(Settings(predictor="constant_velocity")), 8.0, 100)
    assert tree.visits[0] == 100
    for node in range(int(tree.numbers[NODES])):
        children = tree.child[node][tree.child[node] >= 0]
        if len(children):
            assert tree.visits[children].sum() == tree.visits[node]
            mean = (tree.visits[children] * tree.value[children]).sum() / tree.visits[node]
            assert tree.value[node] - tree.reward[node] == pytest.approx(mean)


@pytest.mark.parametrize("prior", ["none", "crafted"])
def test_priors_sum_to_one_over_the_actions_allowed(prior: str) -> None:
    given = rules(Settings(prior=prior, predictor="constant_velocity"))
    tree, believed = searched(straight(), given, 5.0, 20, beliefs(given.depth, variance=3.0))
    for node in (0, 1, 2):
        w = tree.window[node]
        legal = [a * ACTIONS + b for a in range(w[0], w[1] + 1) for b in range(w[2], w[3] + 1)]
        assert sum(prior_of(tree, given, believed, node, action) for action in legal) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("constraints", "root", "below"),
    [("none", 143, 143), ("tree", 81, 143), ("node", 143, 25), ("both", 81, 25)],
)
def test_constraints_leave_the_actions_near_the_last_and_never_the_two_largest_accelerations(
    constraints: str, root: int, below: int
) -> None:
    given = rules(Settings(constraints=constraints, prior="none", predictor="constant_velocity", keeps_lane=False))
    tree, _ = searched(straight(), given, 8.0, 1)
    sizes = [int((w[1] - w[0] + 1) * (w[3] - w[2] + 1)) for w in tree.window[:2].astype(int)]
    assert sizes == [root, below if tree.action[1] // ACTIONS in range(2, 9) else sizes[1]]


def test_the_root_is_bound_to_the_action_executed_before() -> None:
    given = rules(Settings(predictor="constant_velocity", keeps_lane=False))
    tree, _ = searched(straight(), given, 8.0, 1, beliefs(given.depth, last=(2, 11)))
    assert tree.window[0].tolist() == [0, 6, 7, 12]


def test_who_stands_may_choose_any_acceleration() -> None:
    given = rules(Settings(predictor="constant_velocity", keeps_lane=False))
    tree, _ = searched(straight(), given, 0.0, 1, beliefs(given.depth, last=(2, MIDDLE)))
    assert tree.window[0].tolist() == [0, 10, 2, 10]


@pytest.mark.parametrize("prior", ["crafted", "none"])
def test_the_only_safe_plan_is_found(prior: str) -> None:
    """A wall across the whole road 40 m ahead at 9 m/s: a car that does not brake hits it."""
    road = straight(cars=[(40.0, y, 0.0) for y in (-4.0, -2.0, 0.0, 2.0, 4.0)])
    given = rules(Settings(prior=prior, crafted="limit", predictor="constant_velocity"))
    tree, _ = searched(road, given, 9.0, 2048)
    leaf = int(tree.numbers[BEST_LEAF])
    assert tree.outcome[leaf] != FAILED
    assert tree.depth[leaf] == given.depth
    assert tree.state[leaf, S] + CAR.length / 2 < 40.0 - 2.25


def test_a_search_allocates_nothing() -> None:
    road, given = straight(cars=[(25.0, 0.0, 3.0)]), rules(Settings(predictor="constant_velocity"))
    tree, believed = searched(road, given, 8.0, 50)
    arguments = tree, road, CAR, given, CRAFTED_IDM, believed
    _nrt_python.memsys_enable_stats()
    before = rtsys.get_allocation_stats()
    start(*arguments, state_at(8.0))
    once = rtsys.get_allocation_stats().alloc - before.alloc
    before = rtsys.get_allocation_stats()
    search(*arguments, 1, False)
    few = rtsys.get_allocation_stats().alloc - before.alloc
    before = rtsys.get_allocation_stats()
    search(*arguments, 40, False)
    many = rtsys.get_allocation_stats().alloc - before.alloc
    _nrt_python.memsys_disable_stats()
    assert few == many  # the arguments themselves, however much is searched
    assert once <= few + 1


def test_the_same_search_gives_the_same_tree() -> None:
    road, given = straight(cars=[(25.0, 0.0, 3.0)]), rules(Settings(predictor="constant_velocity"))
    a, _ = searched(road, given, 8.0, 100)
    b, _ = searched(road, given, 8.0, 100)
    np.testing.assert_array_equal(a.value, b.value)
    np.testing.assert_array_equal(a.child, b.child)


# The inner simulator


@given(
    speed=st.floats(0.0, 15.0),
    actions=st.lists(st.tuples(st.integers(0, 12), st.integers(0, 12)), min_size=1, max_size=8),
    wheel=st.booleans(),
)
@settings(max_examples=60, deadline=None)
def test_no_action_breaks_a_kinematic_limit(speed: float, actions: list[tuple[int, int]], wheel: bool) -> None:
    road = straight(width=80.0)
    given = rules(Settings(steering="wheel" if wheel else "lane", hold_s=0.1, predictor="constant_velocity"))
    state, before = state_at(speed), MIDDLE
    for step, (a, b) in enumerate(actions * 5):
        old = state.copy()
        advance(road, CAR, given, state, step, a, b, before, np.zeros(TERMS))
        assert 0.0 <= state[SPEED] <= max(road.limit[0], speed) + 0.15
        assert abs(state[STEERING]) <= CAR.max_steering + 1e-9
        assert abs(state[STEERING] - old[STEERING]) <= CAR.steering_rate * 0.1 + 1e-9
        assert -3.0 - 1e-9 <= state[DEMAND] <= 3.0 + 1e-9
        if old[SPEED] >= 0.1:
            assert abs(state[DEMAND] - old[DEMAND]) <= given.jerk * 0.1 + 1e-9
        before = a


def held(road: Situation, speed: float, a: int, b: int = MIDDLE) -> tuple[int, FloatArray, FloatArray]:
    state, terms = state_at(speed), np.zeros(TERMS)
    outcome = advance(road, CAR, rules(Settings(predictor="constant_velocity")), state, 0, a, b, MIDDLE, terms)
    return outcome, state, terms


def test_progress_is_the_share_of_the_way_at_the_limit() -> None:
    _, _, terms = held(straight(limit=10.0), 5.0, MIDDLE)
    assert terms[PROGRESS] == pytest.approx(0.5, abs=1e-6)


@pytest.mark.parametrize(("kind", "penalty"), [("pedestrian", -5.0), ("car", -5.0), ("static", -2.0)])
def test_each_class_has_its_own_penalty_and_a_failure_forfeits_the_rest(kind: str, penalty: float) -> None:
    outcome, _, terms = held(straight(cars=[(8.0, 0.0, 0.0)], kind=kind), 8.0, MIDDLE)
    # Its front is 2.5 m ahead of its centre, the other's rear 2.25 m before its: they meet after 0.5 s of the 8.
    assert (outcome, terms[PROGRESS]) == (FAILED, 0.0)
    assert terms[COLLISION] == pytest.approx(penalty - 7.5, abs=0.11)


def test_a_late_failure_is_better_than_an_early_one() -> None:
    near, far = (held(straight(cars=[(x, 0.0, 0.0)]), 8.0, MIDDLE)[2] for x in (8.0, 11.0))
    assert near[COLLISION] < far[COLLISION] < -5.0


def test_a_closed_line_is_the_end_of_the_road() -> None:
    outcome, _, terms = held(straight(line=6.0), 8.0, MIDDLE)
    assert outcome == FAILED
    assert terms[LINE] < -1.5
    outcome, _, terms = held(straight(line=12.0), 8.0, MIDDLE)
    assert (outcome, terms[LINE]) == (0, 0.0)


def test_off_the_road_ends_the_plan() -> None:
    outcome, _, terms = held(straight(width=2.6), 8.0, MIDDLE, ACTIONS - 1)
    assert outcome == FAILED
    assert terms[ROAD] < -1.0


def test_the_safe_distance_is_missed_in_proportion() -> None:
    def gap(x: float, speed: float) -> float:
        return float(held(straight(cars=[(x, 0.0, speed)]), 8.0, MIDDLE)[2][GAP])

    # At 8 m/s half a second is 4 m, and stopping from 8 m/s with 4 m/s^2 takes 8 m more than stopping from 0.
    assert gap(60.0, 0.0) == 0.0
    assert gap(20.0, 8.0) == 0.0
    assert -3.0 < gap(16.0, 0.0) < gap(20.0, 0.0) < 0.0


@pytest.mark.parametrize(
    ("car", "cost"),
    [
        ((30.0, 0.0, 0.0), 0.0),  # 25.25 m between the two, 17.25 m after the second
        ((20.0, 0.0, 0.0), -4.0),  # 15.25 m, and from 0.61 s on less than the 10.4 m of 1.3 s: two of the five looks
        ((16.0, 0.0, 0.0), -10.0),  # 11.25 m: all five
        ((20.0, 0.0, 8.0), 0.0),  # as fast as the ego
        ((20.0, 3.0, 0.0), 0.0),  # beside its way
        ((-20.0, 0.0, 13.0), 0.0),  # behind it
    ],
)
def test_to_be_about_to_meet_somebody_costs(car: tuple[float, float, float], cost: float) -> None:
    assert held(straight(cars=[car]), 8.0, MIDDLE)[2][MEETING] == pytest.approx(cost)


def test_actions_of_any_length_look_ahead() -> None:
    for hold_s, steps in ((1.0, 1), (0.5, 2), (0.1, 10)):
        given, state, terms, total = rules(Settings(hold_s=hold_s)), state_at(8.0), np.zeros(TERMS), 0.0
        for step in range(steps):
            first = step * given.hold_steps
            advance(straight([(16.0, 0.0, 0.0)]), CAR, given, state, first, MIDDLE, MIDDLE, MIDDLE, terms)
            total += terms[MEETING]
        assert total < -1.0


def test_who_does_not_look_ahead_and_the_thesis_take_no_notice_of_it() -> None:
    for one in (Settings(predictor="constant_velocity", looks_ahead=False), THESIS):
        terms = np.zeros(TERMS)
        advance(straight([(16.0, 0.0, 0.0)]), CAR, rules(one), state_at(8.0), 0, MIDDLE, MIDDLE, MIDDLE, terms)
        assert terms[MEETING] == 0.0


# The thesis's simulator and search

THESIS = Settings(simulator="thesis", walks="node", choice="visits", prior="none", predictor="constant_velocity")


def test_a_simulation_of_the_thesis_adds_one_node_and_follows_the_prior_until_a_walk_ends() -> None:
    given = rules(THESIS)
    tree, _ = searched(straight(), given, 8.0, 20)
    assert tree.numbers[NODES] == 21
    assert tree.depth[1:9].tolist() == list(range(1, 9))
    assert tree.perfect[0] == 1
    assert tree.visits[0] == 20


def test_a_failure_of_the_thesis_forfeits_nothing_and_its_boxes_are_larger() -> None:
    ours, thesis = rules(Settings(predictor="constant_velocity")), rules(THESIS)
    for x, failed in ((8.0, (True, True)), (12.9, (False, True))):
        road, terms = straight(cars=[(x, 0.0, 0.0)]), np.zeros(TERMS)
        found = [advance(road, CAR, given, state_at(8.0), 0, MIDDLE, MIDDLE, MIDDLE, terms) for given in (ours, thesis)]
        assert [one == FAILED for one in found] == list(failed)
        assert terms.sum() == terms[COLLISION] == -5.0


@pytest.mark.parametrize(("given", "costs"), [(Settings(), False), (THESIS, True)])
def test_standing_beside_the_centreline_costs_only_in_the_thesis(given: Settings, costs: bool) -> None:
    road, state, terms = straight(), state_at(0.0), np.zeros(TERMS)
    state[Y] = 1.0
    advance(road, CAR, rules(given), state, 0, 0, MIDDLE, 0, terms)
    assert bool(terms[CENTRING] < -0.4) is costs


def test_what_hardly_moves_and_is_not_to_comes_to_rest() -> None:
    _, state, _ = held(straight(), 0.08, MIDDLE)
    assert state[SPEED] == 0.0


def test_whoever_comes_from_behind_is_not_the_egos_to_avoid() -> None:
    outcome, _, _ = held(straight(cars=[(-8.0, 0.0, 20.0)]), 5.0, MIDDLE)
    assert outcome != FAILED


def test_the_inner_vehicle_moves_like_the_egos() -> None:
    """One second of a lane change at 8 m/s and then braking, against the plant in steps of 0.01 s."""
    from dohyo.agents.mcts.simulator import controls
    from dohyo.sumo_networks.ego.dynamics import Vehicles

    road, given, parameters = straight(width=12.0), rules(Settings(predictor="constant_velocity")), VehicleParameters()
    plant, state = Vehicles(parameters, 1), state_at(8.0)
    plant.place(0, 0.0, 0.0, 0.0)
    plant.states[0, 3] = 8.0
    hold = given._replace(hold_steps=1)
    for tick in range(20):
        a, b = (MIDDLE, MIDDLE + 4) if tick < 10 else (2, MIDDLE)
        target, lateral = (a - MIDDLE) * 0.5, (b - MIDDLE) * 0.5
        demand, wheel = controls(road, CAR, hold, state, target, lateral)
        plant.advance(np.array([[demand + parameters.resistance(plant.states[0, 3]), wheel]]), 0.1)
        advance(road, CAR, hold, state, tick, a, b, a, np.zeros(TERMS))
    assert np.hypot(*(plant.states[0, :2] - state[:2])) < 0.15
    assert plant.states[0, 3] == pytest.approx(state[SPEED], abs=0.1)
    assert ROAD_M > 100.0


def test_who_keeps_its_lane_tries_lines_within_a_metre_also_from_beyond_them() -> None:
    given = rules(Settings(predictor="constant_velocity"))
    tree, _ = searched(straight(), given, 8.0, 1, beliefs(given.depth, last=(MIDDLE, 11)))
    assert tree.window[0].tolist() == [2, 10, 4, 8]
    passing = given._replace(aside=MIDDLE)
    tree, _ = searched(straight(), passing, 8.0, 1, beliefs(given.depth, last=(MIDDLE, 11)))
    assert tree.window[0].tolist() == [2, 10, 7, 12]
