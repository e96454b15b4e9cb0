"""Arms of the study of PRIBOOT: row 19 of the thesis's comparisons, as settings of its trainer and of its agent."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Final

from dohyo.agents.learning.files.settings import read_settings
from dohyo.agents.priboot.training.train import TrainConfig

SETTINGS: Final = Path(__file__).parents[1] / "configs" / "priboot.toml"


@dataclass(frozen=True, slots=True)
class PribootArm:
    """One variant.

    Attributes:
        isolates: Difference from the whole system.
        training: Name of its trainings; "" without one: the autopilot.
        rules: Whether the rules may brake.
        reported: The thesis's driving score, infraction rate score and route completion on Town13, %.
    """

    isolates: str
    training: str
    rules: bool = True
    reported: tuple[float, float, float] | None = None


FURTHER: Final = ("begin={full}", "steps=300", "validate_every=300", "learning_rate=1e-4")
"""The thesis's learning rate, from the weights of `full` on."""
TRAININGS: Final[Mapping[str, tuple[str, ...]]] = MappingProxyType(
    {
        "full": (),
        "no-augmentation": ("displaced=0.0",),
        "masks": ("picture=masks",),
        "data-30": ("share=0.3",),
        "data-10": ("share=0.1",),
        "further": FURTHER,
        "tuned": (*FURTHER, "tuned=true"),
    }
)
"""Settings of each training, on top of `SETTINGS`; {full} is the weights of `full` of the same seed."""
ARMS: Final[Mapping[str, PribootArm]] = MappingProxyType(
    {
        "autopilot": PribootArm("the expert that was recorded", ""),
        "full": PribootArm("", "full", reported=(18.84, 46.97, 74.29)),
        "no-rules": PribootArm("the network and creeping, which then minds nothing", "full", rules=False),
        "no-augmentation": PribootArm("no displaced views", "no-augmentation", reported=(2.66, 5.22, 15.92)),
        "no-augmentation-no-rules": PribootArm("no displaced views, no rules", "no-augmentation", rules=False),
        "masks": PribootArm("masks, convolutions from scratch", "masks", reported=(5.55, 21.08, 54.02)),
        "data-30": PribootArm("30 % of the drives", "data-30"),
        "data-10": PribootArm("10 % of the drives", "data-10"),
        "tuned": PribootArm("the whole trunk learns in 300 further steps", "tuned"),
        "further": PribootArm("300 further steps, the trunk frozen", "further"),
    }
)


def lineage(training: str) -> tuple[str, ...]:
    """Names of the training whose weights one begins from, if any, and of itself."""
    return ("full", training) if any("{full}" in one for one in TRAININGS[training]) else (training,)


def config(training: str, seed: int, runs: Path) -> TrainConfig:
    """Settings of a training, in a folder of trainings TRAINING/seed-N."""
    full = runs / "full" / f"seed-{seed}" / "priboot.safetensors"
    own = (one.format(full=full) for one in TRAININGS[training])
    return read_settings(TrainConfig, SETTINGS, (*own, f"seed={seed}"))
