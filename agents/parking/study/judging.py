"""Judgement of policies and of the expert on held-out lots, by the rules of the benchmarks."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final

import numpy as np

from dohyo.agents.learning.tasks.task import Array
from dohyo.agents.parking.study.arms import REACHED, SIMPLE
from dohyo.agents.parking.training.guided import GuidedVectorEnv
from dohyo.agents.studies.rows import Row
from dohyo.evaluation.parking.benchmark import load_parking_benchmark, scene_of
from dohyo.sumo_networks.parking.rules import JUDGED, Outcome
from dohyo.sumo_networks.parking.rules import SIMPLE as FIRST_REWARD
from dohyo.sumo_networks.parking.vector_env import Level

LOTS: Final = 100
"""Lots in a row of the study."""

Policy = Callable[[Mapping[str, Array]], Array]
"""(N, ...) observations by name -> (N, 3) actions."""


def judged(policy: Policy | None, benchmark: str, block: int) -> Row:
    """Measures of a block of lots, %, all karts together.

    Args:
        policy: Drives all karts; None: the expert.
        benchmark: Of parking, or `REACHED`.
        block: Number of the block.
    """
    lots, rules = (SIMPLE, FIRST_REWARD) if benchmark == REACHED else (benchmark, JUDGED)
    told = load_parking_benchmark(lots)
    karts, first = told.karts, told.seeds[0] + LOTS * block
    driven = GuidedVectorEnv(LOTS, [Level(scene_of(told.scene), rules)], karts)
    seen, _ = driven.reset(seed=[first + row // karts for row in range(driven.num_envs)])
    while driven.running.any():
        actions = driven.expert_actions(driven.running)[0] if policy is None else policy(seen)
        seen, *_ = driven.step(actions)
    results = driven.world.results()
    parked = int(results.success.sum())
    ended = {name: 100.0 * float((results.outcome == outcome).mean()) for name, outcome in _ENDS.items()}
    return {
        **ended,
        "aligned": 100.0 * float(results.aligned.sum()) / parked if parked else None,
        "time_s": float(results.time_s[results.success].mean()) if parked else None,
        "inclination_deg": float(np.degrees(np.median(results.inclination_rad[results.success]))) if parked else None,
    }


_ENDS: Final = {"success": Outcome.PARKED, "collided": Outcome.COLLIDED, "timed_out": Outcome.TIMED_OUT}
