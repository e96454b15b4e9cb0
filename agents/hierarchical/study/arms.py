"""Trained arms: the policies of each, and their settings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

from dohyo.agents.hierarchical.options.manoeuvres import DRIVE, Manoeuvre
from dohyo.agents.learning.files.settings import read_settings
from dohyo.agents.learning.runs.config import RunConfig
from dohyo.agents.learning.runs.trainer import Trainer
from dohyo.agents.studies.training_results import run_folder
from dohyo.agents.trainers import trainer_named
from dohyo.sumo_networks.config import Config

MASTER, FLAT = "master", "flat"
CONFIGS = Path(__file__).parents[1].joinpath("configs")
SUB_POLICIES = tuple(manoeuvre.value for manoeuvre in Manoeuvre)
POLICIES = (*SUB_POLICIES, MASTER, FLAT)
PPO_ALONE = ("ppo.imitated_steps=0", "ppo.learning_rate=3e-4", "ppo.epochs=10")
"""PPO without imitation starts farther from a good policy."""


@dataclass(frozen=True, slots=True)
class TrainedArm:
    """Trainings of an arm.

    Attributes:
        isolates: Difference from the other arms, for legends.
        policies: Of `POLICIES`.
        settings: Of all policies except the master, on top of their file in `CONFIGS`.
        master: Settings of the master.
        options: The arm whose sub-policies its master chooses among; None: its own.
    """

    isolates: str
    policies: tuple[str, ...]
    settings: tuple[str, ...] = ()
    master: tuple[str, ...] = ()
    options: str | None = None


class Options(Config):
    """Options of a run.

    Attributes:
        runs: Folder of the trainings.
    """

    runs: Path = Path("runs/study")


def _guided(percent: int) -> tuple[str, ...]:
    return (*PPO_ALONE, f"ppo.guided_share={percent / 100}")


_LEARNS = ("lane", "braking", "lights")
ARMS: Mapping[str, TrainedArm] = MappingProxyType(
    {
        "ghrl": TrainedArm("rules imitated, then p = 10 %", (*SUB_POLICIES, MASTER)),
        "ghrl-r": TrainedArm(
            "a master trained with rules", (MASTER,), master=("rules_when_critical=true",), options="ghrl"
        ),
        "hrl": TrainedArm("PPO alone", (*SUB_POLICIES, MASTER), _guided(0)),
        "p-5": TrainedArm("PPO, p = 5 %", _LEARNS, _guided(5)),
        "p-10": TrainedArm("PPO, p = 10 %", _LEARNS, _guided(10)),
        "p-20": TrainedArm("PPO, p = 20 %", _LEARNS, _guided(20)),
        "p-10-sum": TrainedArm("p = 10 %, terms summed", _LEARNS, (*_guided(10), "form=sum")),
        "flat": TrainedArm("one policy, PPO alone", (FLAT,), (*_guided(0), "steps=480000")),
        "flat-guided": TrainedArm("one policy, rules imitated, then p = 10 %", (FLAT,)),
        "ghrl-pictures": TrainedArm("as ghrl, from pictures", (*SUB_POLICIES, MASTER), ("state.vision=semantic",)),
    }
)
"""In the order of tables and legends. `flat` has as many steps as HRL's five sub-policies and master together."""


def trainer_of(policy: str) -> Trainer[Any]:
    """Trainer of a policy."""
    return trainer_named(f"hierarchical-{policy}")


def config_of(runs: Path, arm: str, seed: int, policy: str, more: tuple[str, ...] = ()) -> RunConfig:
    """Complete configuration of a training.

    Args:
        runs: Folder of all; a master's sub-policies are there.
        arm: Of `ARMS`.
        seed: Of the training.
        policy: Of the arm's.
        more: Settings on top, as "key=value".

    Raises:
        InvalidInputError: A setting does not exist, or its value is wrong.
    """
    one = ARMS[arm]
    given = [f"seed={seed}", *one.settings]
    if policy == MASTER:
        options = run_folder(runs, one.options or arm, seed, policy).parent
        given = [f"seed={seed}", *one.master, f"options='{options}'"]
    path = CONFIGS / f"{DRIVE if policy == FLAT else policy}.toml"
    config: RunConfig = read_settings(trainer_of(policy).config, path, [*given, *more])
    return config
