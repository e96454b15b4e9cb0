"""Mornings of the study and of the benchmark: arms on the same lead-in, each in a copy of the process."""

from __future__ import annotations

import os
import pickle
import sys
import traceback
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from itertools import product
from typing import Any, Final

from dohyo.agents.speed_planning.study.dissipation import (
    DESIGNS,
    FORECASTS,
    Arm,
    LeadIn,
    Morning,
    controlled,
    watched,
)
from dohyo.agents.studies.arms import Cell, Place
from dohyo.agents.studies.rows import Row
from dohyo.agents.studies.runner import Job
from dohyo.sumo_networks.errors import SimulationError
from dohyo.sumo_networks.freeway.simulation import FreewaySimulation

BENCHMARK, FURTHER = "dissipation", "dissipation-further"
"""Mornings of all arms, and further ones of two designs."""
SEEDS: Final[Mapping[str, range]] = {BENCHMARK: range(10), FURTHER: range(10, 50)}
PLANS: Final = tuple(Arm(design, forecast) for design, forecast in product(DESIGNS[1:], FORECASTS))  # type: ignore[arg-type]
CHOSEN: Final = ("limit+persistence", "rule+persistence")
"""Designs that need neither an oracle nor a training: without a buffer, and with the one by rule."""
PENETRATIONS: Final = (0.01, 0.02, 0.1)
"""Beside the 5 % of all other arms."""
FLEETS: Final = tuple(Arm("rule", "persistence", share) for share in PENETRATIONS)
ARMS: Final[Mapping[str, Arm]] = {arm.name: arm for arm in (Arm(), *PLANS, *FLEETS)}


def morning_place(seed: int, benchmark: str = BENCHMARK) -> Place:
    """Scenario of a seed."""
    return Place(benchmark, "morning", seed)


def lead_in_of(cell: Cell) -> tuple[int | None, float | None]:
    """Key of the lead-in of a cell: its seed and its arm's penetration."""
    return cell.seed, ARMS[cell.arm].penetration


def drive_morning(morning: Morning, forecaster: str, job: Job) -> Iterator[Row]:
    """Drives the arms of one seed; needs a process of its own.

    The lead-in is the same for every arm, so it is driven once, and each arm continues in a copy of the process: SUMO's
    state reaches no other run, and each run equals that of `dissipation.run`.

    Args:
        morning: Settings of the mornings.
        forecaster: Shipped name or file behind the forecast sa-lstm.
        job: Cells of one lead-in, see `lead_in_of`.
    """
    seed = job[0].seed or 0
    morning = morning.of_arm(ARMS[job[0].arm])
    with FreewaySimulation(morning.scenario(seed), fuel=False) as simulation:
        lead_in = LeadIn.driven(simulation, seed, morning.start_s)
        for cell in job:
            try:
                what, work = f"{cell.arm}, seed {seed}", partial(_outcome, lead_in, cell.arm, morning, forecaster)
                yield {**cell._asdict(), **in_a_copy(what, work)}
            except SimulationError as error:
                yield {**cell._asdict(), "lost": str(error)}


def _outcome(lead_in: LeadIn, arm: str, morning: Morning, forecaster: str) -> dict[str, float]:
    return watched(controlled(lead_in, ARMS[arm], morning, forecaster)).as_dict()


def in_a_copy(what: str, work: Callable[[], Any]) -> Any:
    """Result of work in a copy of this process; this process waits for it and stays unchanged.

    Raises:
        SimulationError: The work failed; the copy has printed why.
    """
    sys.stdout.flush()
    reading, writing = os.pipe()
    copy = os.fork()
    if copy == 0:
        status = 1
        try:
            with os.fdopen(writing, "wb") as pipe:
                pickle.dump(work(), pipe)
            status = 0
        except BaseException:
            traceback.print_exc()
        finally:
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(status)
    os.close(writing)
    with os.fdopen(reading, "rb") as pipe:
        answer = pipe.read()
    if os.waitpid(copy, 0)[1]:
        raise SimulationError(f"{what}: the run failed; see the output of its process")
    return pickle.loads(answer)
