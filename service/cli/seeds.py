"""Seeds from the text of an option."""

from __future__ import annotations

import re
from collections import Counter

from dohyo.sumo_networks.errors import InvalidInputError

SEEDS_BELOW = 2**31
MOST_SEEDS = 1_000_000


def parse_seeds(text: str) -> list[int]:
    """Seeds from text such as "0,1,2", "0-4" or "0-4,7"."""
    seeds: list[int] = []
    for part in text.split(","):
        match = re.fullmatch(r"\s*(\d{1,10})(?:-(\d{1,10}))?\s*", part)
        if not match:
            raise InvalidInputError(f"--seeds '{text}': expected numbers such as 0,1,2 or 0-4, got '{part}'")
        first, last = int(match[1]), int(match[2] or match[1])
        if last < first:
            raise InvalidInputError(f"--seeds '{text}': expected the smaller number first, got '{part.strip()}'")
        if last >= SEEDS_BELOW:
            raise InvalidInputError(f"--seeds '{text}': expected numbers below 2^31, got {last}")
        if len(seeds) + last - first >= MOST_SEEDS:
            raise InvalidInputError(f"--seeds '{text}': expected at most {MOST_SEEDS:,} seeds")
        seeds += range(first, last + 1)
    repeated = [seed for seed, times in Counter(seeds).items() if times > 1]
    if repeated:
        raise InvalidInputError(f"--seeds '{text}': expected every seed once, got {repeated[0]} twice")
    return seeds
