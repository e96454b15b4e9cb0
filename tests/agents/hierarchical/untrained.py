"""Untrained sub-policies and masters in the form that training leaves behind."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from gymnasium.spaces import Box

from dohyo.agents.hierarchical.hierarchy import CONFIG, FLAT, MASTER, WEIGHTS, read_sub_policies
from dohyo.agents.hierarchical.master import Master, master_of
from dohyo.agents.hierarchical.options.executor import OptionLimits
from dohyo.agents.hierarchical.options.manoeuvres import DRIVE, Manoeuvre
from dohyo.agents.hierarchical.state.state import StateConfig
from dohyo.agents.hierarchical.training.subpolicies import SubPolicyConfig
from dohyo.agents.hierarchical.training.tasks import ManoeuvreTask
from dohyo.agents.learning.files.settings import as_toml
from dohyo.agents.learning.networks.policy import Actor
from dohyo.agents.learning.policies.export import export
from dohyo.agents.learning.tasks.task import named

TWIN = StateConfig(vision="none")


def write_sub_policies(folder: Path, names: tuple[str, ...] = (*Manoeuvre, FLAT), state: StateConfig = TWIN) -> Path:
    """One run's folder for each, with small networks that speed up gently."""
    torch.manual_seed(0)
    for name in names:
        task = ManoeuvreTask(DRIVE if name == FLAT else name, state)
        low, high = (torch.from_numpy(bound) for bound in (task.action_space.low, task.action_space.high))
        actor = Actor(task.observation_space.shape[0], low, high, (8,))
        with torch.no_grad():
            actor.body[-1].bias[0] = 0.4  # or they would never leave
        (folder / name).mkdir(parents=True)
        (folder / name / CONFIG).write_text(as_toml(SubPolicyConfig(state=state)))
        export(actor, named(task.observation_space), folder / name / Path(WEIGHTS).stem, {})
    return folder


def write_master(folder: Path) -> Master:
    """A master over the sub-policies of a folder, as its run leaves it."""
    torch.manual_seed(1)
    master = master_of(read_sub_policies(folder), (8,), OptionLimits())
    (folder / MASTER).mkdir()
    export(master, named(Box(-np.inf, np.inf, (master.size + 8,))), folder / MASTER / Path(WEIGHTS).stem, {})
    return master
