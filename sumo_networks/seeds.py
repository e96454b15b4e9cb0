"""Seeds of episodes: all of them, the range for training, and the seed of each training episode."""

from __future__ import annotations

from typing import Final

import numpy as np

from dohyo.sumo_networks.errors import InvalidInputError

SEEDS: Final = 2**31
"""Number of seeds: whole numbers from 0 on."""
HELD_OUT_FROM: Final = 2**30
"""Seeds below this number are for training; seeds from this number to 2^31 are held out."""


def episode_seed(seed: object) -> int:
    """The seed of an episode as int, which numpy's whole numbers may give too.

    Raises:
        InvalidInputError: It is no whole number from 0 to 2^31 - 1.
    """
    if isinstance(seed, bool) or not isinstance(seed, int | np.integer) or not 0 <= seed < SEEDS:
        raise InvalidInputError(f"expected a seed, a whole number from 0 to {SEEDS - 1}, got {seed!r}")
    return int(seed)


def training_seed(run_seed: int, episode: int) -> int:
    """Seed of one training episode, in [0, `HELD_OUT_FROM`); different episodes are statistically independent.

    Args:
        run_seed: Seed of the whole run.
        episode: Number of the episode within the run.
    """
    return int(np.random.SeedSequence(run_seed, spawn_key=(episode,)).generate_state(1)[0] % HELD_OUT_FROM)
