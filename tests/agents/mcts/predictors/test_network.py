"""The network's symmetries, its padding, and its export."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from safetensors.torch import save_file

from dohyo.agents.mcts.predictors.export import export, load_network
from dohyo.agents.mcts.predictors.features import AGENTS, LANES, SHAPES, features, padded
from dohyo.agents.mcts.predictors.learned import Learned
from dohyo.agents.mcts.predictors.network import MotionNetwork
from dohyo.agents.planning.scene import Scene
from dohyo.sumo_networks.errors import InvalidInputError
from tests.agents.mcts.predictors.scenes import busy, moved, turned

FEW = settings(max_examples=10, deadline=None)


@pytest.fixture(scope="module")
def network() -> MotionNetwork:
    torch.set_num_threads(1)
    torch.manual_seed(1)
    made = MotionNetwork().eval()
    with torch.no_grad():
        made.head[-1].weight *= 10.0  # futures that differ visibly from constant velocity
    return made


def poses(network: MotionNetwork, inputs: dict[str, np.ndarray]) -> np.ndarray:
    with torch.no_grad():
        return network(**{name: torch.from_numpy(array)[None] for name, array in inputs.items()})[0].numpy()


def permuted(now: Scene, actors: np.ndarray, lanes: np.ndarray) -> Scene:
    a, m = now.actors, now.lanes
    new_row = np.argsort(lanes)
    return replace(
        now,
        actors=a.take(actors),
        lanes=replace(
            m,
            **{name: getattr(m, name)[lanes] for name in m.__slots__ if name != "following"},
            following=np.where(m.following >= 0, new_row[m.following], -1)[lanes],
        ),
    )


@given(seed=st.integers(0, 1000), order=st.permutations(range(12)), lanes=st.permutations(range(9)))
@FEW
def test_permuting_actors_permutes_outputs_and_lanes_have_no_order(network, seed, order, lanes):
    now, order, lanes = busy(seed), np.array(order), np.array(lanes)
    before, after = poses(network, features(now)), poses(network, features(permuted(now, order, lanes)))
    np.testing.assert_allclose(after[0], before[0], atol=2e-4)
    np.testing.assert_allclose(after[1:13], before[1:13][order], atol=2e-4)


@given(
    seed=st.integers(0, 1000),
    dx=st.floats(-50, 50),
    dy=st.floats(-50, 50),
    angle=st.floats(-3.1, 3.1),
)
@FEW
def test_a_scene_seen_from_elsewhere_has_the_same_futures(network, seed, dx, dy, angle):
    now = busy(seed)
    before, after = poses(network, features(now)), poses(network, features(moved(now, dx, dy, angle)))
    off = after[:13] - turned(before[:13], dx, dy, angle)
    np.testing.assert_allclose(off[..., :2], 0.0, atol=1e-2)
    np.testing.assert_allclose(np.sin(off[..., 2] / 2), 0.0, atol=1e-2)


def test_padding_changes_nothing(network):
    inputs = padded(features(busy(3)))
    agents, lanes = int(inputs["agents_valid"].sum()), int(inputs["lanes_valid"].sum())
    short = {name: a[: lanes if name in ("points", "lanes", "lanes_valid") else agents] for name, a in inputs.items()}
    full = poses(network, inputs)
    np.testing.assert_allclose(full[:agents], poses(network, short), atol=1e-4)
    rng = np.random.default_rng(0)
    for name, array in inputs.items():
        if not name.endswith("_valid") or name == "history_valid":
            rows = lanes if name in ("points", "lanes") else agents
            array[rows:] = rng.normal(size=array[rows:].shape) * 20
    np.testing.assert_allclose(poses(network, inputs)[:agents], full[:agents], atol=1e-4)


def test_actors_and_lanes_matter(network):
    now = busy(5)
    nothing = poses(network, features(replace(now, lanes=busy(5, lanes=0).lanes)))
    elsewhere = poses(network, features(replace(now, lanes=busy(6).lanes)))
    everything = poses(network, features(now))
    assert np.abs(everything[:13] - nothing[:13]).max() > 0.01
    assert np.abs(everything[:13] - elsewhere[:13]).max() > 0.01


def test_a_red_light_matters(network):
    now = busy(5)
    switched = replace(now, lanes=replace(now.lanes, red=~now.lanes.red))
    assert np.abs(poses(network, features(now)) - poses(network, features(switched))).max() > 1e-3


def test_features_are_as_long_as_the_scene_needs_and_are_padded_to_one_size():
    for actors, lanes in ((0, 0), (60, 90), (30, 64), (7, 20)):
        seen = features(busy(1, actors, lanes))
        assert {len(seen[name]) for name in ("history", "agents", "rolled")} == {min(actors, AGENTS - 1) + 1}
        assert {len(seen[name]) for name in ("points", "lanes")} == {min(max(lanes, 1), LANES)}
        inputs = padded(seen)
        assert {name: array.shape for name, array in inputs.items()} == SHAPES
        assert all(array.dtype == np.float32 and np.isfinite(array).all() for array in inputs.values())
        assert inputs["agents_valid"].sum() == min(actors, AGENTS - 1) + 1
        assert inputs["lanes_valid"].sum() == min(lanes, LANES)


def test_lanes_of_no_length_give_finite_outputs_and_gradients(network):
    now = busy(2)
    now = replace(now, lanes=replace(now.lanes, points=np.repeat(now.lanes.points[:, :1], 20, axis=1)))
    fresh = MotionNetwork()
    out = fresh(**{name: torch.from_numpy(array)[None] for name, array in features(now).items()})
    out.sum().backward()
    assert torch.isfinite(out).all()
    assert all(torch.isfinite(p.grad).all() for p in fresh.parameters() if p.grad is not None)


def test_the_export_gives_the_same_outputs(network, tmp_path: Path):
    save_file(network.state_dict(), tmp_path / "predictor.safetensors")
    export(load_network(tmp_path / "predictor.safetensors"), tmp_path / "predictor.onnx")
    learned = Learned(tmp_path / "predictor.onnx")
    for seed, actors in ((0, 12), (1, 0), (2, 50)):
        now = busy(seed, actors)
        rows = min(actors, AGENTS - 1) + 1
        np.testing.assert_allclose(learned.poses(now)[:rows], poses(network, features(now))[:rows], atol=1e-4)


def test_what_is_no_predictor_is_refused_in_one_line(tmp_path: Path):
    for name, content in (("a.safetensors", b"nothing"), ("b.safetensors", None)):
        if content is not None:
            (tmp_path / name).write_bytes(content)
        with pytest.raises(InvalidInputError) as raised:
            load_network(tmp_path / name)
        assert name in str(raised.value)
        assert "\n" not in str(raised.value)
    save_file({"head.0.weight": torch.zeros(3)}, tmp_path / "c.safetensors")
    with pytest.raises(InvalidInputError, match="of this network"):
        load_network(tmp_path / "c.safetensors")
