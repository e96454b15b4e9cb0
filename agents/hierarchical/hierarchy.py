"""Hierarchy: the trained parts in a folder: a run of `dohyo train` for each sub-policy, and one for the master.

    runs/ghrl/lane/{config.toml,best.safetensors}, runs/ghrl/left/..., runs/ghrl/master/...

Of a run, only these two files are read.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor

from dohyo.agents.hierarchical.options.actuation import Steering
from dohyo.agents.hierarchical.options.manoeuvres import DRIVE, Manoeuvre
from dohyo.agents.hierarchical.state.state import StateConfig, StateEncoder
from dohyo.agents.hierarchical.state.views import rows_seen
from dohyo.agents.learning.files.settings import read_settings
from dohyo.agents.learning.networks.policy import Actor
from dohyo.sumo_networks.config import Config
from dohyo.sumo_networks.errors import InvalidInputError

CONFIG, WEIGHTS = "config.toml", "best.safetensors"
MASTER, FLAT = "master", "flat"


class Manner(Config, extra="ignore"):
    """What a driver needs to know of a sub-policy's training; see `training.subpolicies.SubPolicyConfig`.

    Attributes:
        state: Configuration of the state.
        steering: Kind of steering.
    """

    state: StateConfig = StateConfig()
    steering: Steering = Steering.POLICY


@dataclass(frozen=True, slots=True)
class SubPolicy:
    """One trained policy.

    Attributes:
        actor: Its network.
        rows: Indices of the numbers of a state that it sees.
        files: Its files.
    """

    actor: Actor
    rows: Tensor
    files: tuple[Path, ...]


@dataclass(frozen=True, slots=True)
class SubPolicies:
    """Sub-policies trained on the same kind of state.

    Attributes:
        state: Configuration of their state.
        steering: Kind of steering.
        policies: By `Manoeuvre`, or "flat".
    """

    state: StateConfig
    steering: Steering
    policies: Mapping[str, SubPolicy]

    @property
    def files(self) -> tuple[Path, ...]:
        """Files of the sub-policies."""
        return tuple(file for policy in self.policies.values() for file in policy.files)


def read_sub_policies(folder: Path, names: tuple[str, ...] = tuple(Manoeuvre)) -> SubPolicies:
    """Reads sub-policies from a folder of runs.

    Args:
        folder: Holds a run's folder for each.
        names: Of `Manoeuvre`, or "flat".

    Raises:
        InvalidInputError: One is missing, damaged, or made for other states or another steering than the first.
    """
    configs = {name: read_settings(Manner, run_file(folder, name, CONFIG)) for name in names}
    first = configs[names[0]]
    for name, config in configs.items():
        if (config.state, config.steering) != (first.state, first.steering):
            raise InvalidInputError(
                f"'{folder}': expected sub-policies of one state and steering, '{names[0]}' has {_kind(first)} "
                f"and '{name}' {_kind(config)}"
            )
    encoder = StateEncoder(first.state)
    return SubPolicies(first.state, first.steering, {name: _read(folder, name, encoder) for name in names})


def run_file(folder: Path, name: str, file: str) -> Path:
    """A file of a run.

    Raises:
        InvalidInputError: It is missing; the message has the command that makes it.
    """
    path = folder / name / file
    if not path.exists():
        config = DRIVE if name == FLAT else name
        raise InvalidInputError(
            f"no '{name}' in '{folder}' ({file} is missing); it is made by: dohyo train hierarchical-{name} "
            f"--config agents/hierarchical/configs/{config}.toml --out {folder / name}"
        )
    return path


def _read(folder: Path, name: str, encoder: StateEncoder) -> SubPolicy:
    path = run_file(folder, name, WEIGHTS)
    actor, rows = Actor.load(path), rows_seen(encoder, DRIVE if name == FLAT else name)
    if actor.sizes[0] != len(rows):
        raise InvalidInputError(f"'{path}': expected a policy of {len(rows)} inputs, got {actor.sizes[0]}")
    return SubPolicy(actor, torch.from_numpy(rows), (path, folder / name / CONFIG))


def _kind(config: Manner) -> str:
    return f"vision '{config.state.vision}', localization '{config.state.localization}', steering '{config.steering}'"
