"""Feature cache: computed once, named by all that decides it, and never half-written."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
import torch
from torch import Tensor
from torch.nn.functional import interpolate

from dohyo.agents.perception.drives import Column
from dohyo.agents.perception.encoders.base import Encoder
from dohyo.agents.perception.encoders.rlad import RladEncoder
from dohyo.agents.perception.feature_cache import cached_features, features_digest
from dohyo.sumo_networks.errors import InvalidInputError


class Counting(Encoder):
    """Means of the channels, times a weight; counts the pictures that it reads."""

    def __init__(self, stop_after: int | None = None) -> None:
        super().__init__((3, 8, 8), 3)
        self.weight = torch.nn.Parameter(torch.tensor(2.0))
        self.read, self.stop_after = 0, stop_after

    def encode(self, pictures: Tensor) -> Tensor:
        if self.stop_after is not None and self.read >= self.stop_after:
            raise KeyboardInterrupt
        self.read += len(pictures)
        return self.weight * pictures.mean((2, 3))


@dataclass(frozen=True)
class Resized:
    side: int

    def __call__(self, pictures: Tensor) -> Tensor:
        return interpolate(pictures.float() / 255.0, (self.side, self.side))


@pytest.fixture
def pictures() -> Column:
    return Column.of(np.random.default_rng(0).integers(0, 256, (20, 3, 8, 8), dtype=np.uint8))


def test_a_second_use_reads_the_file(pictures, tmp_path):
    encoder = Counting()
    done: list[int] = []
    first = cached_features(encoder, pictures, tmp_path, batch=8, progress=done.append)
    np.testing.assert_allclose(first, 2.0 * pictures[:].mean((2, 3)) / 255.0, rtol=1e-5)
    assert done == [8, 16, 20]
    assert encoder.read == 20
    again = cached_features(encoder, pictures, tmp_path, batch=8)
    assert encoder.read == 20
    assert isinstance(again, np.memmap)
    np.testing.assert_array_equal(first, again)
    with pytest.raises(ValueError, match="read-only"):
        again[0] = 0.0
    assert sorted(path.suffix for path in tmp_path.iterdir() if path.suffix != ".lock") == [".npy"]


def test_an_interrupted_computation_goes_on_with_the_next_batch(pictures, tmp_path):
    with pytest.raises(KeyboardInterrupt):
        cached_features(Counting(stop_after=16), pictures, tmp_path, batch=8)
    digest = features_digest(Counting(), pictures)
    assert not (tmp_path / f"{digest}.npy").exists()
    encoder = Counting()
    features = cached_features(encoder, pictures, tmp_path, batch=8)
    assert encoder.read == 4
    np.testing.assert_array_equal(features, cached_features(Counting(), pictures, tmp_path / "whole", batch=8))


def test_a_damaged_draft_is_computed_again(pictures, tmp_path):
    with pytest.raises(KeyboardInterrupt):
        cached_features(Counting(stop_after=8), pictures, tmp_path, batch=8)
    (draft,) = tmp_path.glob("*.part.npy")
    draft.write_bytes(draft.read_bytes()[:100])
    encoder = Counting()
    cached_features(encoder, pictures, tmp_path, batch=8)
    assert encoder.read == 20


def test_all_that_decides_the_features_names_them(pictures):
    encoder, other = Counting(), Counting()
    with torch.no_grad():
        other.weight.add_(1e-3)
    names = {
        features_digest(encoder, pictures),
        features_digest(other, pictures),
        features_digest(encoder, Column.of(pictures[:19])),
        features_digest(encoder, Column.of(255 - pictures[:])),
        features_digest(encoder, pictures, Resized(8)),
        features_digest(encoder, pictures, Resized(4)),
    }
    assert len(names) == 6
    assert features_digest(Counting(), Column.of(pictures[:].copy())) in names
    with pytest.raises(InvalidInputError, match="repr gives its settings"):
        features_digest(encoder, pictures, lambda batch: batch)


def test_pictures_are_prepared(tmp_path):
    large = Column.of(np.random.default_rng(0).integers(0, 256, (5, 3, 16, 16), dtype=np.uint8))
    features = cached_features(Counting(), large, tmp_path, prepare=Resized(8))
    np.testing.assert_allclose(features, 2.0 * large[:][:, :, ::2, ::2].mean((2, 3)) / 255.0, rtol=1e-5)


def test_an_encoder_is_used_in_evaluation_and_left_as_it_was(tmp_path):
    torch.manual_seed(0)
    encoder = RladEncoder((3, 64, 64), features=16).train()
    pictures = Column.of(np.random.default_rng(1).integers(0, 256, (6, 3, 64, 64), dtype=np.uint8))
    features = cached_features(encoder, pictures, tmp_path, batch=4)
    assert encoder.training
    with torch.no_grad():
        expected = encoder.eval()(torch.from_numpy(pictures[:]))
    np.testing.assert_allclose(features, expected, atol=1e-5)


def test_damaged_features_are_one_clear_error(pictures, tmp_path):
    cached_features(Counting(), pictures, tmp_path)
    (path,) = tmp_path.glob("*.npy")
    path.write_bytes(path.read_bytes()[:150])
    with pytest.raises(InvalidInputError, match=r"damaged.*remove the file"):
        cached_features(Counting(), pictures, tmp_path)
    np.save(path, np.zeros((3, 3), np.float32))
    with pytest.raises(InvalidInputError, match=r"expected float32 \(20, 3\)"):
        cached_features(Counting(), pictures, tmp_path)
    with pytest.raises(InvalidInputError, match="got none"):
        cached_features(Counting(), Column.of(pictures[:0]), tmp_path)
