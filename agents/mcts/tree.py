"""The tree: PUCT over flat preallocated arrays, in numba.

A simulation walks from the root to the horizon, or to a failure, and creates every missing node on its way: without a
value network at the leaves, each walk ends where its return is known. Selection, expansion, evaluation and back-up are
the thesis's; CHOICES.md lists what is ours.
"""

from __future__ import annotations

import math
import os
from typing import NamedTuple

import numpy as np

from dohyo.agents.mcts.config import ACTIONS, DT, MIDDLE, Rules
from dohyo.agents.mcts.kernels import inlined, kernel
from dohyo.agents.mcts.simulator import FAILED, SPEED, STATE, TERMS, advance, crafted_centre
from dohyo.agents.mcts.value.mlp import Mlp, no_value, value_of
from dohyo.agents.planning.motion import Body, Idm
from dohyo.agents.planning.situation import Situation
from dohyo.sumo_networks.arrays import FloatArray, IntArray
from dohyo.sumo_networks.errors import InvalidInputError

PAIRS = ACTIONS * ACTIONS
NODES, PERFECT_FIRST, BEST_LEAF, DRAWN, WALKED = range(5)


class Tree(NamedTuple):
    """A search, M nodes at most; node 0 is the root. Edges are kept with the node they lead to.

    Attributes:
        numbers: (5,) number of nodes, whether the first rollout was perfect, the leaf of the best rollout, draws used,
            whether a walk has come to an end: a failure or the horizon.
        child: (M, 169) node under each action, -1 where not tried.
        parent: (M,) node above.
        action: (M,) the action that led here, acceleration index times 13 plus steering index.
        depth: (M,) actions since the root.
        state: (M, 10) see `simulator.STATE`.
        terms: (M, 11) terms of the reward of the action that led here.
        reward: (M,) their sum.
        beyond: (M,) value network's estimate after a walk that ends here, else 0.
        outcome: (M,) `simulator.ALIVE` or FAILED.
        visits: (M,) N.
        value: (M,) Q, the mean return of the action that led here.
        prior: (M,) P of that action.
        perfect: (M,) rollouts through here that reached the horizon without failure.
        best: (M,) the best return through here, from the root on.
        window: (M, 4) first and last index of acceleration, first and last of steering, all inclusive.
        centre: (M, 3) centre of the crafted prior's acceleration, norm of the crafted, norm of the learned prior.
        path: (D + 1,) nodes of the walk in progress.
    """

    numbers: IntArray
    child: np.ndarray
    parent: np.ndarray
    action: np.ndarray
    depth: np.ndarray
    state: FloatArray
    terms: FloatArray
    reward: FloatArray
    beyond: FloatArray
    outcome: np.ndarray
    visits: np.ndarray
    value: FloatArray
    prior: FloatArray
    perfect: np.ndarray
    best: FloatArray
    window: np.ndarray
    centre: FloatArray
    path: np.ndarray


def make_tree(simulations: int, depth: int) -> Tree:
    """Memory for a search.

    Raises:
        InvalidInputError: This machine has less.
    """
    nodes = simulations * depth + 1
    needed = nodes * sum(array.nbytes for array in _tree(1, 0))
    most = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    if needed > most:
        raise InvalidInputError(
            f"{simulations} simulations of {depth} actions: expected a tree of at most the {most / 1e9:.1f} GB of "
            f"memory that this machine has, got one of {needed / 1e9:.1f} GB"
        )
    return _tree(nodes, depth)


def _tree(nodes: int, depth: int) -> Tree:
    return Tree(
        numbers=np.zeros(5, dtype=np.int64),
        child=np.full((nodes, PAIRS), -1, dtype=np.int32),
        parent=np.zeros(nodes, dtype=np.int32),
        action=np.zeros(nodes, dtype=np.int32),
        depth=np.zeros(nodes, dtype=np.int32),
        state=np.zeros((nodes, STATE)),
        terms=np.zeros((nodes, TERMS)),
        reward=np.zeros(nodes),
        beyond=np.zeros(nodes),
        outcome=np.zeros(nodes, dtype=np.int8),
        visits=np.zeros(nodes, dtype=np.int32),
        value=np.zeros(nodes),
        prior=np.zeros(nodes),
        perfect=np.zeros(nodes, dtype=np.int32),
        best=np.zeros(nodes),
        window=np.zeros((nodes, 4), dtype=np.int8),
        centre=np.zeros((nodes, 3)),
        path=np.zeros(depth + 1, dtype=np.int32),
    )


class Beliefs(NamedTuple):
    """Inputs of a search.

    Attributes:
        kernel: (13,) the priors' Gaussian by index distance.
        learned: (D, 2) indices of the learned prior's action at each depth; -1 where it does not hold.
        order: (169,) rank of every action, which decides between equal values without a bias to one side.
        plan: (D,) actions to try first, -1 for none.
        last: (2,) indices of the action executed before.
        draws: (K,) uniform in [0, 1), one per step of a random walk; empty for a search.
        value: The value network; used only with `Rules.bootstrap`.
    """

    kernel: FloatArray
    learned: IntArray
    order: IntArray
    plan: IntArray
    last: IntArray
    draws: FloatArray
    value: Mlp = no_value()


@kernel
def start(tree: Tree, road: Situation, car: Body, rules: Rules, idm: Idm, beliefs: Beliefs, state: FloatArray) -> None:
    """Empties the tree and puts the ego's state at its root."""
    used = tree.numbers[NODES]
    for node in range(used):
        for pair in range(PAIRS):
            tree.child[node, pair] = -1
    tree.numbers[:] = 0
    tree.numbers[NODES] = 1
    tree.parent[0], tree.action[0], tree.depth[0], tree.outcome[0] = (
        -1,
        beliefs.last[0] * ACTIONS + beliefs.last[1],
        0,
        0,
    )
    for i in range(STATE):
        tree.state[0, i] = state[i]
    tree.terms[0, :] = 0.0
    tree.reward[0], tree.visits[0], tree.value[0], tree.prior[0], tree.perfect[0] = 0.0, 0, 0.0, 1.0, 0
    tree.beyond[0] = 0.0
    tree.best[0] = -math.inf
    _open(tree, road, car, rules, idm, beliefs, 0)


@kernel
def search(
    tree: Tree, road: Situation, car: Body, rules: Rules, idm: Idm, beliefs: Beliefs, simulations: int,
    early_stop: bool,
) -> int:  # fmt: skip
    """Runs simulations on a started tree; another call continues.

    Args:
        tree: The tree.
        road: The situation.
        car: The vehicle.
        rules: The numbers.
        idm: Of the crafted prior.
        beliefs: The priors.
        simulations: Their number.
        early_stop: Stop if the rollout that follows the prior alone is perfect.

    Returns:
        Number of simulations.
    """
    by_prior, end = 1 if beliefs.plan[0] >= 0 else 0, walk_end(rules)
    for simulation in range(simulations):
        node, steps, made = 0, 0, False
        tree.path[0] = 0
        following = beliefs.plan[0] >= 0 and tree.visits[0] == 0
        prior_only = tree.numbers[WALKED] == 0 if rules.one_node else tree.visits[0] == by_prior
        while tree.depth[node] < end and tree.outcome[node] != FAILED and not (made and rules.one_node):
            action = -1
            if following:
                action = _planned(tree, beliefs, node)
                following = action >= 0
            if action < 0:
                if len(beliefs.draws) > 0 and not prior_only:
                    action = draw(tree, rules, beliefs, node)
                else:
                    action = select(tree, rules, beliefs, node, prior_only)
            child = tree.child[node, action]
            if child < 0:
                child = _expand(tree, road, car, rules, idm, beliefs, node, action)
                made = True
            steps += 1
            tree.path[steps] = child
            node = child
        perfect = tree.outcome[node] != FAILED and tree.depth[node] == end
        if perfect or tree.outcome[node] == FAILED:
            tree.numbers[WALKED] = 1
        back_up(tree, steps, perfect)
        if early_stop and prior_only and perfect:
            tree.numbers[PERFECT_FIRST] = 1
            return simulation + 1
    return simulations


@inlined
def walk_end(rules: Rules) -> int:
    """Actions after which a walk ends."""
    return min(rules.bootstrap, rules.depth) if rules.bootstrap > 0 else rules.depth


@kernel
def _planned(tree: Tree, beliefs: Beliefs, node: int) -> int:
    """Action of the previous tick's plan, if the constraints still allow it."""
    action = beliefs.plan[tree.depth[node]]
    if action < 0:
        return -1
    a, b = action // ACTIONS, action % ACTIONS
    w = tree.window[node]
    return int(action) if w[0] <= a <= w[1] and w[2] <= b <= w[3] else -1


@inlined
def prior_of(tree: Tree, rules: Rules, beliefs: Beliefs, node: int, action: int) -> float:
    """P of an action under a node: the mean of the priors in force, each normalised over the actions allowed."""
    a, b = action // ACTIONS, action % ACTIONS
    total, parts = 0.0, 0
    if rules.crafted:
        total += (
            beliefs.kernel[abs(a - int(tree.centre[node, 0]))] * beliefs.kernel[abs(b - MIDDLE)] / tree.centre[node, 1]
        )
        parts += 1
    depth = tree.depth[node]
    if beliefs.learned[depth, 0] >= 0:
        near = beliefs.kernel[abs(a - beliefs.learned[depth, 0])] * beliefs.kernel[abs(b - beliefs.learned[depth, 1])]
        total += near / tree.centre[node, 2]
        parts += 1
    if parts == 0:
        w = tree.window[node]
        return 1.0 / float((w[1] - w[0] + 1.0) * (w[3] - w[2] + 1.0))
    return float(total / parts)


@kernel
def select(tree: Tree, rules: Rules, beliefs: Beliefs, node: int, prior_only: bool) -> int:
    """The action of the highest Q + c P sqrt(sum N) / (1 + N).

    Args:
        tree: The tree.
        rules: The numbers.
        beliefs: The priors.
        node: The node.
        prior_only: Follow the prior alone, as the first rollout does (the thesis's code).
    """
    w, children = tree.window[node], tree.child[node]
    # Every walk through a node continues to a child, so its visits are the sum of its children's; but for the walk that
    # made it, where a simulation adds one node.
    tried = tree.visits[node] - (1 if rules.one_node and node > 0 else 0)
    if rules.one_node and tried == 0:
        prior_only = True
    root = rules.exploration * math.sqrt(tried)
    untried = tree.value[node] - tree.reward[node] if rules.parent_first else 0.0
    crafted, centre, mass = rules.crafted > 0, int(tree.centre[node, 0]), tree.centre[node, 1]
    depth, mass_learned = tree.depth[node], tree.centre[node, 2]
    la, lb = beliefs.learned[depth, 0], beliefs.learned[depth, 1]
    parts = (1 if crafted else 0) + (1 if la >= 0 else 0)
    uniform = 1.0 / ((w[1] - w[0] + 1.0) * (w[3] - w[2] + 1.0))
    kernel, rank, before = beliefs.kernel, beliefs.order, tree.action[node] // ACTIONS
    best, chosen = -math.inf, -1
    for a in range(w[0], w[1] + 1):
        for b in range(w[2], w[3] + 1):
            action = a * ACTIONS + b
            child = children[action]
            if child < 0:
                p = uniform if parts == 0 else 0.0
                if crafted:
                    p += kernel[abs(a - centre)] * kernel[abs(b - MIDDLE)] / (mass * parts)
                if la >= 0:
                    p += kernel[abs(a - la)] * kernel[abs(b - lb)] / (mass_learned * parts)
                score = p if prior_only else untried + root * p
            elif prior_only:
                score = tree.prior[child] / (1.0 if rules.one_node else 1.0 + tree.visits[child])
            else:
                score = tree.value[child] + root * tree.prior[child] / (1.0 + tree.visits[child])
            if node > 0:
                score -= rules.effort * abs(a - MIDDLE) + rules.effort_change * abs(a - before)
            if score > best or (score == best and rank[action] < rank[chosen]):
                best, chosen = score, action
    return int(chosen)


@kernel
def draw(tree: Tree, rules: Rules, beliefs: Beliefs, node: int) -> int:
    """Action drawn from the prior, independent of earlier results: random shooting."""
    w, left = tree.window[node], beliefs.draws[tree.numbers[DRAWN] % len(beliefs.draws)]
    tree.numbers[DRAWN] += 1
    action = w[0] * ACTIONS + w[2]
    for a in range(w[0], w[1] + 1):
        for b in range(w[2], w[3] + 1):
            action = a * ACTIONS + b
            left -= prior_of(tree, rules, beliefs, node, action)
            if left < 0.0:
                return int(action)
    return int(action)


@inlined
def _expand(
    tree: Tree, road: Situation, car: Body, rules: Rules, idm: Idm, beliefs: Beliefs, node: int, action: int
) -> int:
    child = tree.numbers[NODES]
    tree.numbers[NODES] = child + 1
    tree.child[node, action] = child
    tree.parent[child], tree.action[child], tree.depth[child] = node, action, tree.depth[node] + 1
    tree.visits[child], tree.value[child], tree.perfect[child], tree.best[child] = 0, 0.0, 0, -math.inf
    tree.prior[child] = prior_of(tree, rules, beliefs, node, action)
    for i in range(STATE):
        tree.state[child, i] = tree.state[node, i]
    first = tree.depth[node] * rules.hold_steps
    before = tree.action[node] // ACTIONS
    tree.outcome[child] = advance(
        road, car, rules, tree.state[child], first, action // ACTIONS, action % ACTIONS, before, tree.terms[child]
    )
    reward = 0.0
    for i in range(TERMS):
        reward += tree.terms[child, i]
    tree.reward[child], tree.beyond[child] = reward, 0.0
    if tree.outcome[child] != FAILED:
        if tree.depth[child] < walk_end(rules):
            _open(tree, road, car, rules, idm, beliefs, child)
        elif tree.depth[child] < rules.depth:
            time = tree.depth[child] * rules.hold_steps * DT
            tree.beyond[child] = value_of(beliefs.value, road, car, rules, tree.state[child], time)
    return int(child)


@inlined
def _open(tree: Tree, road: Situation, car: Body, rules: Rules, idm: Idm, beliefs: Beliefs, node: int) -> None:
    """The constraints and priors of the actions under a node."""
    reach = (rules.root_window if node == 0 else rules.node_window) - 1
    a, b = tree.action[node] // ACTIONS, tree.action[node] % ACTIONS
    w = tree.window[node]
    w[0], w[1] = max(a - reach, 0), min(a + reach, rules.largest)
    right, left = MIDDLE - rules.aside, MIDDLE + rules.aside
    b = min(max(b, right), left)
    w[2], w[3] = max(b - reach, right), min(b + reach, left)
    if tree.state[node, SPEED] < rules.standing:
        w[0], w[1] = 0, rules.largest
    if rules.crafted:
        time = tree.depth[node] * rules.hold_steps * DT
        centre = crafted_centre(road, car, rules, idm, tree.state[node], time)
        tree.centre[node, 0] = centre
        tree.centre[node, 1] = _mass(beliefs.kernel, w[0], w[1], centre) * _mass(beliefs.kernel, w[2], w[3], MIDDLE)
    depth = tree.depth[node]
    if beliefs.learned[depth, 0] >= 0:
        ahead = _mass(beliefs.kernel, w[0], w[1], beliefs.learned[depth, 0])
        tree.centre[node, 2] = ahead * _mass(beliefs.kernel, w[2], w[3], beliefs.learned[depth, 1])


@kernel
def _mass(kernel: FloatArray, first: int, last: int, centre: int) -> float:
    total = 0.0
    for i in range(first, last + 1):
        total += kernel[abs(i - centre)]
    return total


@kernel
def back_up(tree: Tree, steps: int, perfect: bool) -> None:
    """Q <- (N Q + G) / (N + 1), N <- N + 1 along the walk, G being the undiscounted return from each action on."""
    beyond = tree.beyond[tree.path[steps]]
    total = beyond
    for k in range(1, steps + 1):
        total += tree.reward[tree.path[k]]
    if total > tree.best[0]:
        tree.numbers[BEST_LEAF] = tree.path[steps]
    ahead = beyond
    for k in range(steps, -1, -1):
        node = tree.path[k]
        ahead += tree.reward[node]
        n = tree.visits[node]
        tree.value[node] = (n * tree.value[node] + ahead) / (n + 1)
        tree.visits[node] = n + 1
        tree.perfect[node] += perfect
        tree.best[node] = max(tree.best[node], total)


@kernel
def best_child(tree: Tree, node: int, choice: int, bonus: int) -> int:
    """Child to continue with: most visits and bonuses (0), highest Q (1), or on the best rollout (2); -1 for none."""
    best, chosen = -math.inf, -1
    for pair in range(PAIRS):
        child = tree.child[node, pair]
        if child < 0 or tree.visits[child] == 0:
            continue
        if choice == 0:
            score = tree.visits[child] + bonus * tree.perfect[child] + 1e-6 * tree.value[child]
        else:
            score = tree.value[child] if choice == 1 else tree.best[child]
        if score > best:
            best, chosen = score, child
    return int(chosen)
