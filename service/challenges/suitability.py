"""Whether the conditions of a new phase suit its benchmark."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Final

from dohyo.evaluation.families import Family
from dohyo.evaluation.significance import FEWEST
from dohyo.service.benchmarks.catalog import AnyBenchmark, family_of
from dohyo.service.challenges.orders import PhaseOrder
from dohyo.service.errors import BodyError
from dohyo.service.evaluations.orders import check_slow_policy
from dohyo.service.forecasting.interface import TRACK as FORECASTERS
from dohyo.service.freeway.planner import TRACK as PLANNERS
from dohyo.service.parking.interface import TRACK as PARKERS

TRACKS: Final[Mapping[Family, tuple[str, ...]]] = {
    Family.FREEWAY: (PLANNERS,),
    Family.PARKING: (PARKERS, "privileged"),  # which built-in agents may be
    Family.FORECASTING: (FORECASTERS,),
}
"""Tracks on which agents of a family can be submitted; without an entry: all."""


def check_phase(order: PhaseOrder, benchmark: AnyBenchmark, seeds: Sequence[int]) -> None:
    """Refuses a phase whose board could not tell agents apart, whose seeds are known, or that nobody could enter.

    Nor may a simulation run on without its agent where records do not tell of it.

    Args:
        order: The phase.
        benchmark: Its benchmark.
        seeds: Seeds of all its runs.

    Raises:
        BodyError: It is such a phase.
    """
    if benchmark.size * len(seeds) < FEWEST:
        least = math.ceil(FEWEST / benchmark.size)
        raise BodyError(
            "seeds" if order.draw_seeds is None else "draw_seeds",
            f"expected at least {least} seeds, so that the board can tell agents apart: a run on '{benchmark.name}' "
            f"has {benchmark.size} scenarios for each seed, and needs {FEWEST}",
        )
    if order.secret and (public := sorted(set(order.seeds or ()) & set(benchmark.seeds))):
        known = ", ".join(map(str, public[:10]))
        raise BodyError("seeds", f"expected none of the benchmark's own seeds in a secret phase, got {known}")
    check_slow_policy(order.slow_policy, benchmark)
    tracks = TRACKS.get(family_of(benchmark))
    if order.track is not None and tracks is not None and order.track not in tracks:
        expected = " or ".join(f"'{one}'" for one in tracks)
        raise BodyError("track", f"expected {expected} for agents on '{benchmark.name}', or no track")
