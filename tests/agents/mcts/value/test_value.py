"""The value network: by hand, in the search, and from the search's own results."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import torch
from numba import njit
from numba.core.runtime import _nrt_python, rtsys
from safetensors.numpy import load_file, save

from dohyo.agents.learning.files.report import no_report
from dohyo.agents.learning.runs.trainer import TrainRequest
from dohyo.agents.mcts.config import LATERAL_LIMIT, MIDDLE, Rules, Settings, rules
from dohyo.agents.mcts.mbappe import CRAFTED_IDM, Mbappe
from dohyo.agents.mcts.predictors.dataset import Shard
from dohyo.agents.mcts.prior import kernel
from dohyo.agents.mcts.simulator import DEMAND, FAILED, SPEED, STATE, S, X
from dohyo.agents.mcts.tree import BEST_LEAF, NODES, PAIRS, Beliefs, Tree, make_tree, search, start
from dohyo.agents.mcts.value.mlp import (
    FEATURES,
    SHAPES,
    SHIPPED,
    Mlp,
    describe,
    evaluate,
    load_value,
    no_value,
    value_of,
)
from dohyo.agents.mcts.value.records import LEAST_VISITS, found_in
from dohyo.agents.mcts.value.train import ValueConfig, layers, train, weights
from dohyo.agents.planning.motion import body
from dohyo.agents.planning.situation import Situation
from dohyo.evaluation.agent import Mission
from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.ego.dynamics import VehicleParameters
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.scenario import Place
from tests.agents.mcts.predictors.scenes import busy, sampled
from tests.agents.mcts.roads import observation, straight

CAR = body(VehicleParameters(), LATERAL_LIMIT)
TO_HORIZON = rules(Settings(predictor="constant_velocity"))
TO_4_S = rules(Settings(predictor="constant_velocity", value="network"))
NOBODY = Mission(start=Place(lane=""), goal=Place(lane=""))


def state_at(speed: float, s: float = 0.0, demand: float = 0.0) -> FloatArray:
    state = np.zeros(STATE)
    state[X], state[SPEED], state[S], state[DEMAND] = s - CAR.axle, speed, s, demand
    return state


def constant(value: float) -> Mlp:
    """A network that says the same of everything."""
    network = no_value()
    network.last_bias[0] = value
    return network


def random_network(seed: int = 0) -> Mlp:
    rng, network = np.random.default_rng(seed), no_value()
    for array in network[:6]:
        array[:] = rng.normal(0.0, 0.3, array.shape)
    return network


def searched(road: Situation, given: Rules, value: Mlp, simulations: int = 100, speed: float = 8.0) -> Tree:
    beliefs = Beliefs(
        kernel=kernel(100.0),
        learned=np.full((given.depth, 2), -1, dtype=np.int64),
        order=np.arange(PAIRS, dtype=np.int64),
        plan=np.full(given.depth, -1, dtype=np.int64),
        last=np.array([MIDDLE, MIDDLE], dtype=np.int64),
        draws=np.zeros(0),
        value=value,
    )
    tree = make_tree(simulations, given.depth)
    start(tree, road, CAR, given, CRAFTED_IDM, beliefs, state_at(speed))
    search(tree, road, CAR, given, CRAFTED_IDM, beliefs, simulations, False)
    return tree


def test_its_layers_are_those_it_was_trained_with() -> None:
    torch.manual_seed(0)
    network, rng = layers(), np.random.default_rng(0)
    mean, scale = torch.from_numpy(rng.normal(size=FEATURES)).float(), torch.full((FEATURES,), 0.7)
    mlp = no_value()._replace(**{name: a.astype(np.float64) for name, a in weights(network, mean, scale).items()})
    for _ in range(5):
        values = torch.from_numpy(rng.normal(size=FEATURES)).float()
        mlp.features[:] = values.numpy()
        assert evaluate(mlp) == pytest.approx(network((values - mean) / scale).item(), abs=1e-5)


def test_two_units_by_hand() -> None:
    mlp = no_value()
    mlp.first[0, 1], mlp.first[1, 1], mlp.first_bias[1] = 2.0, -1.0, 0.5
    mlp.second[3, 0], mlp.second[3, 1] = 1.0, 10.0
    mlp.last[0, 3], mlp.last_bias[0] = 3.0, -1.0
    mlp.features[1] = 1.5  # 2 x 1.5 = 3, and -1.5 + 0.5 is cut off: 3 x 3 - 1
    assert evaluate(mlp) == pytest.approx(8.0)
    mlp.features[1] = -0.5  # cut off, and 0.5 + 0.5 = 1: 3 x 10 - 1
    assert evaluate(mlp) == pytest.approx(29.0)


def features_of(road: Situation, state: FloatArray, time: float = 4.0) -> FloatArray:
    out = np.full(FEATURES, np.nan)
    describe(road, CAR, TO_4_S, state, time, out)
    assert np.isfinite(out).all()
    return out


def test_what_it_sees_of_a_state() -> None:
    free = features_of(straight(limit=10.0), state_at(8.0, demand=-1.5))
    assert free[[0, 1, 2, 9]] == pytest.approx([0.5, 0.8, -0.5, 1.0])
    assert free[[15, 16, 18, 20]] == pytest.approx(1.0)  # no line, and no leader now or later
    led = features_of(straight(cars=[(30.0, 0.0, 3.0)], limit=10.0), state_at(8.0))
    gap = 30.0 + 4.0 * 3.0 - 4.5  # in 4 s
    assert led[16] == pytest.approx(gap / (gap + 10.0), abs=0.01)
    assert led[17] == pytest.approx(0.3, abs=0.01)
    assert features_of(straight(line=22.25), state_at(8.0))[15] == pytest.approx(20.0 / 30.0)
    assert features_of(straight(line=1.0), state_at(8.0))[15] == 1.0  # already behind its front
    assert (features_of(straight(), state_at(8.0), time=6.0)[[0, 23]] < free[[0, 23]]).all()


def test_a_constant_value_changes_no_plan_but_shifts_what_it_is_worth() -> None:
    road = straight(cars=[(25.0, 0.0, 3.0)])
    nothing, three = (searched(road, TO_4_S, constant(value)) for value in (0.0, 3.0))
    assert three.best[0] == pytest.approx(nothing.best[0] + 3.0)
    assert int(three.numbers[BEST_LEAF]) == int(nothing.numbers[BEST_LEAF])


def test_walks_end_where_the_network_is_asked_or_where_they_fail() -> None:
    tree = searched(straight(cars=[(24.0, 0.0, 0.0)]), TO_4_S, random_network())
    used = slice(1, int(tree.numbers[NODES]))
    depth, failed, beyond = tree.depth[used], tree.outcome[used] == FAILED, tree.beyond[used]
    assert depth.max() == 4
    assert failed.any()
    assert (beyond[(depth < 4) | failed] == 0.0).all()
    assert (beyond[(depth == 4) & ~failed] != 0.0).all()


def test_what_it_says_is_backed_up() -> None:
    """Q of a node is the mean over its walks of what came below, the network's word included."""
    tree, value = searched(straight(), TO_4_S, random_network()), 0.0
    leaf = int(tree.numbers[BEST_LEAF])
    value, node = float(tree.beyond[leaf]), leaf
    assert value == pytest.approx(value_of(random_network(), straight(), CAR, TO_4_S, tree.state[leaf], 4.0))
    while node > 0:
        value, node = value + float(tree.reward[node]), int(tree.parent[node])
    assert tree.best[0] == pytest.approx(value)
    for node in range(int(tree.numbers[NODES])):
        below = [c for c in tree.child[node].tolist() if c >= 0]
        if below:
            n = tree.visits[below]
            mean = float((tree.value[below] * n).sum() / n.sum())
            assert tree.value[node] == pytest.approx(tree.reward[node] + mean)


def test_without_the_option_no_network_is_asked() -> None:
    road = straight(cars=[(25.0, 0.0, 3.0)])
    plain, with_one = searched(road, TO_HORIZON, no_value()), searched(road, TO_HORIZON, random_network())
    assert plain.best[0] == with_one.best[0]
    assert not with_one.beyond.any()
    assert plain.depth[: int(plain.numbers[NODES])].max() == 8


@njit
def _ask(mlp: Mlp, road: Situation, given: Rules, state: FloatArray, times: int) -> float:
    total = 0.0
    for i in range(times):
        total += value_of(mlp, road, CAR, given, state, 0.01 * i)
    return total


def test_it_allocates_nothing() -> None:
    road, state, network = straight(cars=[(25.0, 0.0, 3.0)]), state_at(8.0), random_network()
    _ask(network, road, TO_4_S, state, 1)
    _nrt_python.memsys_enable_stats()
    try:
        counts = []
        for times in (1, 100):
            before = rtsys.get_allocation_stats().alloc
            _ask(network, road, TO_4_S, state, times)
            counts.append(rtsys.get_allocation_stats().alloc - before)
        assert counts[0] == counts[1]  # the arguments alone
    finally:
        _nrt_python.memsys_disable_stats()


def test_the_agent_decides_the_same_twice_with_it() -> None:
    agent = Mbappe(predictor="constant_velocity", value="network")
    drives = []
    for _ in range(2):
        agent.reset(NOBODY, 3)
        seen = [observation([(30.0 - x, 0.0, 3.0)], speed=8.0, limit=10.0) for x in range(4)]
        drives.append(np.stack([agent.act(one) for one in seen]))
    assert (drives[0] == drives[1]).all()
    assert agent.tree.depth[: int(agent.tree.numbers[NODES])].max() == 4


def test_the_shipped_one_finds_a_free_road_worth_more_than_a_blocked_one() -> None:
    network, state = load_value(), state_at(9.0)
    free = value_of(network, straight(width=3.2), CAR, TO_4_S, state, 4.0)
    blocked = value_of(network, straight(cars=[(16.0, 0.0, 0.0)], width=3.2), CAR, TO_4_S, state, 4.0)
    assert 1.5 < free <= 4.0
    assert blocked < free - 1.0


def test_a_second_is_worth_one_at_most() -> None:
    assert value_of(constant(99.0), straight(), CAR, TO_4_S, state_at(9.0), 5.0) == 3.0
    assert value_of(constant(-99.0), straight(), CAR, TO_4_S, state_at(9.0), 5.0) == -99.0


def test_records_are_the_best_returns_below_what_was_tried_often() -> None:
    tree = searched(straight(cars=[(25.0, 0.0, 3.0)]), TO_HORIZON, no_value(), simulations=400)
    found = found_in(tree, straight(cars=[(25.0, 0.0, 3.0)]), CAR, TO_HORIZON)
    depth = tree.depth[: int(tree.numbers[NODES])]
    often = tree.visits[: len(depth)] >= LEAST_VISITS
    assert len(found) == int((often & (depth >= 2) & (depth < 8) & (tree.outcome[: len(depth)] != FAILED)).sum()) > 0
    node, below = int(tree.numbers[BEST_LEAF]), 0.0
    chain = []
    while depth[node] > 2:
        below += float(tree.reward[node])
        chain.append(node)
        node = int(tree.parent[node])
    if often[node]:
        assert np.isclose(found.returns, below).any()
    assert found.returns.max() <= 6.0 + 1e-6


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder: Path = tmp_path_factory.mktemp("motion")
    for split, seeds in (("train", range(4)), ("validation", range(9, 11))):
        (folder / split).mkdir()
        shard = Shard.of([sampled(busy(seed, actors=5, lanes=4)) for seed in seeds])
        (folder / split / "a.npz").write_bytes(shard.to_bytes())
    return folder


def test_training_ends_with_the_same_network_and_uses_the_records_that_are_there(data: Path, tmp_path: Path) -> None:
    config = ValueConfig(data=data, every=1, simulations=200, steps=200, tensorboard=False)

    def order(out: str) -> TrainRequest:
        return TrainRequest("value", tmp_path / out, False, no_report)

    first, second = train(config, order("a")), train(config, order("b"))
    assert first.read_bytes() == second.read_bytes()
    report = json.loads((tmp_path / "a" / "value.json").read_text())
    assert report["train"]["mean_absolute_error"] < report["train"]["mean_absolute_error_of_the_mean"]
    assert set(load_file(first)) == set(SHAPES)
    load_value(first)
    with pytest.raises(InvalidInputError, match="--resume"):
        train(config, order("a"))
    (tmp_path / "c").mkdir()
    for split in ("train", "validation"):
        name = f"records-{split}.npz"
        (tmp_path / "c" / name).write_bytes((tmp_path / "a" / name).read_bytes())
    anew = config.model_copy(update={"data": tmp_path / "nothing"})
    assert train(anew, order("c")).read_bytes() == first.read_bytes()


def test_a_wrong_file_is_told_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(InvalidInputError, match="no value network"):
        load_value(tmp_path / "none.safetensors")
    (tmp_path / "bad.safetensors").write_bytes(SHIPPED.read_bytes()[:-9])
    with pytest.raises(InvalidInputError, match="damaged"):
        load_value(tmp_path / "bad.safetensors")
    (tmp_path / "other.safetensors").write_bytes(save({"first": np.zeros((2, 2), np.float32)}))
    with pytest.raises(InvalidInputError, match="expected the arrays"):
        load_value(tmp_path / "other.safetensors")
    arrays = load_file(SHIPPED)
    arrays["first"][0, 0] = np.nan
    (tmp_path / "nan.safetensors").write_bytes(save(arrays))
    with pytest.raises(InvalidInputError, match="NaN"):
        load_value(tmp_path / "nan.safetensors")
