"""Arms: what a study compares, and its cells: arms x trainings x scenarios."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product
from typing import Any, Final, NamedTuple

from dohyo.agents.registry import resolve_with
from dohyo.evaluation.agent import Agent, make_agent

TRAININGS: Final = (0, 1, 2)
"""Seeds of the trainings of an arm: as many as a verdict needs, see `claims`."""


@dataclass(frozen=True, slots=True)
class Arm:
    """One variant of a system.

    Attributes:
        agent: Registered name of the agent that drives, or of the trainer.
        settings: Settings of the agent or trainer.
        trained: Folder of its trainings in RUNS; None without a training.
        isolates: Difference from the arm that it is compared with.
        reported: Value that the source reports; None without one.
    """

    agent: str
    settings: Mapping[str, Any] = field(default_factory=dict)
    trained: str | None = None
    isolates: str = ""
    reported: float | None = None

    def make(self, **more: Any) -> Agent:
        """Agent of the arm, with more settings.

        Raises:
            InvalidInputError: The agent cannot be made with these settings.
        """
        return make_agent(*resolve_with(self.agent, {**self.settings, **more}))


class Place(NamedTuple):
    """Scenario of a cell.

    Attributes:
        benchmark: Benchmark, task or data set.
        scenario: Name of the scenario in it.
        seed: Seed of the scenario; None without one.
    """

    benchmark: str
    scenario: str
    seed: int | None


class Cell(NamedTuple):
    """One measurement of a study, and the identity of its row.

    Attributes:
        arm: Name of the arm.
        training_seed: Seed of the arm's training; None without a training.
        benchmark: See `Place`.
        scenario: See `Place`.
        seed: See `Place`.
    """

    arm: str
    training_seed: int | None
    benchmark: str
    scenario: str
    seed: int | None


@dataclass(frozen=True, slots=True)
class Block:
    """A full factorial part of a study.

    Attributes:
        arms: Names of arms.
        trainings: Seeds of the trainings of each arm.
        places: Scenarios of each training.
    """

    arms: Sequence[str]
    trainings: Sequence[int | None]
    places: Sequence[Place]


def cells_of(blocks: Iterable[Block]) -> list[Cell]:
    """Cells of all blocks, each once; all arms of a scenario come before the next scenario."""
    found = (
        Cell(arm, training, *place)
        for block in blocks
        for place, arm, training in product(block.places, block.arms, block.trainings)
    )
    return list(dict.fromkeys(found))
