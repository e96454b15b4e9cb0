"""The interface of a planner: what a policy worker sees and decides in a freeway morning."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

from dohyo.evaluation.benchmarks.benchmark import Benchmark
from dohyo.service.benchmarks.catalog import AnyBenchmark
from dohyo.sumo_networks.errors import InvalidInputError

TRACK: Final = "privileged"
STATE: Final = "speeds"
"""The planner's only sensor: (lanes, cells) of speeds, m/s."""
CONTROL: Final = "target_speeds"
"""The planner's control: (lanes, cells) of target speeds, m/s."""
DECIDES_EVERY_S: Final = 60.0
"""Simulated time between two plans, s."""


def check_planner(track: str, sensors: Sequence[str]) -> None:
    """Checks the specification of a planner.

    Raises:
        InvalidInputError: A planner has another track, or other sensors.
    """
    if track != TRACK or list(sensors) != [STATE]:
        raise InvalidInputError(
            f"control '{CONTROL}' is that of a planner of freeway mornings: expected track '{TRACK}' and sensors "
            f"['{STATE}'], got track '{track}' and {list(sensors)}"
        )


def check_kind(info: Mapping[str, Any], benchmark: AnyBenchmark) -> None:
    """Checks that a submission can do what a benchmark asks for: drive cars, or plan speeds on the freeway.

    Raises:
        InvalidInputError: It is of the other kind.
    """
    plans, wanted = info["control"] == CONTROL, not isinstance(benchmark, Benchmark)
    if plans == wanted:
        return
    kinds = {True: f"planners (control '{CONTROL}')", False: "agents that drive cars"}
    raise InvalidInputError(
        f"benchmark '{benchmark.name}' is for {kinds[wanted]}, and '{info['name']}' has control '{info['control']}'"
    )
