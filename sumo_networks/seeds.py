"""Seeds of episodes: all of them, the range for training, the seed of each training episode, and their checks."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Final

import numpy as np

from dohyo.sumo_networks.errors import InvalidInputError

SEEDS: Final = 2**31
"""Number of seeds: whole numbers from 0 on."""
HELD_OUT_FROM: Final = 2**30
"""Seeds below this number are for training; seeds from this number to 2^31 are held out."""


def training_seed(run_seed: int, episode: int) -> int:
    """Seed of one training episode, in [0, `HELD_OUT_FROM`); different episodes are statistically independent.

    Args:
        run_seed: Seed of the whole run.
        episode: Number of the episode within the run.
    """
    return int(np.random.SeedSequence(run_seed, spawn_key=(episode,)).generate_state(1)[0] % HELD_OUT_FROM)


def checked_seed(seed: object, below: int | None = None) -> int:
    """A seed as int, which numpy's whole numbers may give too.

    Raises:
        InvalidInputError: It is no whole number of at least 0, or not `below` a number.
    """
    end = math.inf if below is None else below
    if isinstance(seed, bool) or not isinstance(seed, int | np.integer) or not 0 <= seed < end:
        bounds = "of at least 0" if below is None else f"from 0 to {below - 1}"
        raise InvalidInputError(f"expected a seed, a whole number {bounds}, got {seed!r}")
    return int(seed)


def episode_seed(seed: object) -> int:
    """The seed of an episode of dohyo's own environments.

    Raises:
        InvalidInputError: It is no whole number from 0 to 2^31 - 1.
    """
    return checked_seed(seed, SEEDS)


def episode_seeds(seeds: object) -> list[int]:
    """The seeds of a list, each as by `episode_seed`.

    Raises:
        InvalidInputError: It is no list, or one of them is no seed.
    """
    if isinstance(seeds, str) or not isinstance(seeds, Iterable):
        raise InvalidInputError(f"expected a list of seeds, got {seeds!r}")
    return [episode_seed(seed) for seed in seeds]
