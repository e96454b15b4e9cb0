"""Seeds of episodes: all of them, the range for training, and the seed of each training episode."""

from __future__ import annotations

from typing import Final

import numpy as np

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
