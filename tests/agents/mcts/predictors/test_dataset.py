"""The motion dataset: what goes in comes out, and damage is told."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dohyo.agents.mcts.predictors.dataset import SCHEMA, Shard, load_shard, shards_of
from dohyo.agents.mcts.predictors.features import features
from dohyo.sumo_networks.errors import InvalidInputError
from tests.agents.mcts.predictors.scenes import busy, sampled


@pytest.fixture(scope="module")
def shard() -> Shard:
    return Shard.of([sampled(busy(seed, actors=seed % 5, lanes=seed % 3)) for seed in range(7)])


def write(shard: Shard, path: Path, **changed: np.ndarray) -> Path:
    path.write_bytes(Shard({**shard.arrays, **changed}).to_bytes())
    return path


def same(a: object, b: object) -> None:
    """All fields of two scenes, one after another."""
    for one in fields(a):  # type: ignore[arg-type]
        x, y = getattr(a, one.name), getattr(b, one.name)
        if hasattr(x, "__slots__"):
            same(x, y)
        else:
            np.testing.assert_allclose(np.asarray(x, float), np.asarray(y, float), rtol=1e-6, atol=1e-5)


def test_every_scene_comes_back_as_it_was(shard, tmp_path):
    back = load_shard(write(shard, tmp_path / "a.npz"))
    assert len(back) == 7
    for seed, sample in enumerate(back):
        now = busy(seed, actors=seed % 5, lanes=seed % 3)
        same(now, sample.scene)
        same(sampled(now), sample)


def test_the_same_samples_give_the_same_bytes(shard):
    assert shard.to_bytes() == Shard.of(list(shard)).to_bytes()


def test_inputs_know_nothing_of_the_future(shard):
    rng = np.random.default_rng(0)
    other = dict(shard.arrays)
    for name in SCHEMA:
        if name.endswith("future"):
            other[name] = rng.normal(size=other[name].shape).astype(np.float32)
        elif name.endswith("future_valid"):
            other[name] = ~other[name]
    for a, b in zip(shard, Shard(other), strict=True):
        for name, array in features(a.scene).items():
            np.testing.assert_array_equal(array, features(b.scene)[name])


@given(cut=st.floats(0.0, 0.999))
@settings(max_examples=25, deadline=None)
def test_a_shard_cut_short_is_refused_in_one_line(shard, tmp_path_factory, cut):
    path, content = tmp_path_factory.mktemp("cut") / "cut.npz", shard.to_bytes()
    path.write_bytes(content[: int(cut * len(content))])
    refused(path)


@given(at=st.floats(0.02, 0.95), bit=st.integers(0, 7))
@settings(max_examples=40, deadline=None)
def test_a_flipped_bit_is_refused_or_changes_nothing(shard, tmp_path_factory, at, bit):
    path, content = tmp_path_factory.mktemp("bit") / "bit.npz", bytearray(shard.to_bytes())
    content[int(at * len(content))] ^= 1 << bit
    path.write_bytes(content)
    try:
        back = load_shard(path)
    except InvalidInputError:
        return
    for name, array in shard.arrays.items():
        np.testing.assert_array_equal(back.arrays[name], array)


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("time", np.zeros(3, np.float32), "expected pose as float32"),
        ("pose", np.zeros((7, 3)), "expected pose as float32"),
        ("actors_count", np.ones(7, np.int32), "actors_key"),
        ("lanes_count", -np.ones(7, np.int32), "counts in lanes_count"),
        ("ego", np.full((7, 6), np.nan, np.float32), "ego holds NaN or infinity"),
    ],
)
def test_arrays_that_do_not_fit_are_named(shard, tmp_path, name, value, message):
    path = write(shard, tmp_path / "b.npz", **{name: value})
    assert message in refused(path)


def test_another_schema_and_missing_arrays_are_refused(shard, tmp_path):
    np.savez(tmp_path / "c.npz", schema=np.int32(0), **shard.arrays)
    assert "expected schema 1" in refused(tmp_path / "c.npz")
    np.savez(tmp_path / "d.npz", schema=np.int32(1), time=shard.arrays["time"])
    assert "wrong arrays" in refused(tmp_path / "d.npz")
    np.savez(tmp_path / "e.npz", schema=np.int32(1), **{**shard.arrays, "time": np.array([{}], dtype=object)})
    assert "damaged" in refused(tmp_path / "e.npz")
    assert "no motion shard" in refused(tmp_path / "f.npz")


def test_a_split_without_shards_is_refused(tmp_path):
    with pytest.raises(InvalidInputError, match="dohyo dataset motion"):
        shards_of(tmp_path, "train")


def refused(path: Path) -> str:
    with pytest.raises(InvalidInputError) as raised:
        load_shard(path)
    assert str(path) in str(raised.value)
    assert "\n" not in str(raised.value)
    return str(raised.value)
