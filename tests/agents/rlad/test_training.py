"""Training of RLAD and of its rivals: a killed run goes on to the bit."""

from __future__ import annotations

from pathlib import Path
from typing import get_args

import pytest
from tensordict import TensorDict

from dohyo.agents.endless_driving.observation import PICTURE
from dohyo.agents.learning.files.settings import read_settings
from dohyo.agents.rlad.training import Algorithm, RladRunConfig
from dohyo.sumo_networks.errors import InvalidInputError
from tests.agents.learning.killed import killed_and_resumed


@pytest.mark.parametrize("algorithm", get_args(Algorithm))
def test_a_killed_run_ends_bit_equal_to_one_that_was_not(algorithm: str, tmp_path: Path) -> None:
    whole = killed_and_resumed("tests.agents.rlad.drawn:DRAWN", [f"algorithm={algorithm}"], tmp_path, onnx=False)
    frames = TensorDict.load_memmap(whole / "replay")[f"observation.{PICTURE}"]
    assert frames.flatten(1).any(dim=1).all()  # the ring is full


@pytest.mark.slow
def test_so_does_one_of_the_town_in_sumo(tmp_path: Path) -> None:
    settings = ["town.roads=one-route", "steps=48", "checkpoint_every=16", "evaluate_every=100", "tensorboard=false"]
    settings += ["device=cpu", "sac.hidden=[16]", "sac.batch=4", "sac.learning_starts=8", "sac.round_steps=8"]
    settings += ["sac.updates_per_step=0.25", "sac.replay.capacity=64"]
    whole = killed_and_resumed("rlad", settings, tmp_path, onnx=False)
    assert TensorDict.load_memmap(whole / "replay")[f"observation.{PICTURE}"][:48].flatten(1).any(dim=1).all()


@pytest.mark.parametrize(
    ("layers", "said"),
    [
        ("[]", r"latent\.layers: Tuple should have at least 1 item"),
        ("[[24, 0]]", r"latent\.layers\.0\.1: Input should be greater than 0, got 0"),
        ("[[0, 4]]", r"latent\.layers\.0\.0: Input should be greater than 0, got 0"),
        ("[[24, -2]]", r"latent\.layers\.0\.1: Input should be greater than 0, got -2"),
    ],
)
def test_convolutions_without_channels_or_stride_are_refused(layers: str, said: str) -> None:
    with pytest.raises(InvalidInputError, match=said):
        read_settings(RladRunConfig, None, [f"latent.layers={layers}"])
