"""GHRL: a master chooses among learned sub-policies; in critical situations (RSS), answer-set rules drive alone.

    dohyo evaluate --agent ghrl --set arm=ghrl-r --set checkpoint=runs/ghrl --benchmark nocrash

Arms, and the part of the checkpoint that each reads: `flat` the flat policy's run, all others the master's. HRL's
sub-policies come from a checkpoint trained without rules; only in GHRL-R rules drive. In `ghrl-s` (ours) they are a
shield at all times: the policies drive, and may brake harder than the rules would, never less.
Source: Albilani 2023, chapter 6.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import torch

from dohyo.agents.hierarchical.hierarchy import FLAT, MASTER, WEIGHTS, SubPolicy, read_sub_policies, run_file
from dohyo.agents.hierarchical.master import Master, parts, read_master
from dohyo.agents.hierarchical.options.executor import OptionExecutor, OptionView
from dohyo.agents.hierarchical.options.manoeuvres import DRIVE, Manoeuvre
from dohyo.agents.hierarchical.state.master_observation import OPTIONS, MasterObservation
from dohyo.agents.learning.policies.exact import exact
from dohyo.agents.rules.rules_only import RulesOnly
from dohyo.evaluation.agent import Agent, AgentSpec, Explanation, Mission, Observation
from dohyo.evaluation.settings import OneOf
from dohyo.sumo_networks.arrays import Float32Array
from dohyo.sumo_networks.errors import InvalidInputError, UnknownNameError

ARMS = ("hrl", "ghrl", "ghrl-r", "ghrl-s", "flat")
CHECKPOINT = Path(__file__).with_name("checkpoints")


class Ghrl(Agent):
    """See the module.

    Attributes:
        files: Files that decide its actions, beside its code.
    """

    def __init__(
        self, arm: Annotated[str, OneOf(ARMS)] = "ghrl-r", checkpoint: str | Path | None = None, lines: bool = True
    ) -> None:
        """Reads the networks.

        Args:
            arm: What drives: a name of `ARMS`, see the module.
            checkpoint: Folder of the runs; None: the shipped ones.
            lines: Whether GHRL-R's rules drive before a closed line, too; the thesis's RSS knows no lines.

        Raises:
            UnknownNameError: There is no such arm.
            InvalidInputError: A part is missing or damaged; the message has the command that trains it.
        """
        if arm not in ARMS:
            raise UnknownNameError("arm", arm, ARMS)
        folder, self._arm = _shipped(arm) if checkpoint is None else Path(checkpoint), arm
        rules = RulesOnly() if arm == "ghrl-r" else None
        self._guard = RulesOnly() if arm == "ghrl-s" else None
        self._flat: SubPolicy | None = None
        self._master: Master | None = None
        if arm == FLAT:
            policies = read_sub_policies(folder, (FLAT,))
            self._flat, self.files = policies.policies[FLAT], policies.files
            self._answer = exact(self._flat.actor)
            state, self._steering = policies.state, policies.steering
        else:
            path = run_file(folder, MASTER, WEIGHTS)
            self._master, self.files = read_master(path), (path,)
            self._answer = exact(self._master)
            state, self._steering = self._master.manner.state, self._master.manner.steering
        self.files = (*self.files, *(file for one in (rules, self._guard) if one is not None for file in one.files))
        self._outlook = MasterObservation(state, rules, lines)
        self.files = (*self.files, *self._outlook.encoder.files)
        if self._master is not None and self._master.size != self._outlook.encoder.size:
            raise InvalidInputError(
                f"'{folder / MASTER}': expected a master of states of {self._outlook.encoder.size} numbers, "
                f"got {self._master.size}"
            )
        self.spec = AgentSpec(
            name=f"ghrl-{arm}" if arm == FLAT else arm,
            track="privileged",
            sensors=self._outlook.sensors,
            control="acceleration_steering",
        )
        self._forget()

    def warm_up(self) -> None:
        """Observes an empty road."""
        self._outlook.warm_up()
        if self._guard is not None:
            self._guard.warm_up()

    def reset(self, mission: Mission, seed: int) -> None:
        """Clears the state of the last episode."""
        torch.set_num_threads(1)
        self._outlook.reset(mission, seed)
        if self._guard is not None:
            self._guard.reset(mission, seed)
        self._forget()

    def _forget(self) -> None:
        self._conductor = OptionExecutor(self._master.manner.tempo) if self._master is not None else None
        self._prospect: OptionView | None = None
        self._ruled = self._braked = False

    def act(self, observation: Observation) -> np.ndarray:
        """Action of the running option, of the rules, or of the flat policy."""
        outlook = self._outlook
        outlook.update(observation)
        action = self._chosen() if self._flat is None else self._answer(outlook.state[self._flat.rows.numpy()])
        self._ruled = outlook.critical
        if self._ruled:
            return outlook.obey_rules()
        if self._option is not None:
            outlook.follow(self._option)
        controls = outlook.controls(action, self._steering)
        return controls if self._guard is None else self._guarded(self._guard, controls)

    def _guarded(self, guard: RulesOnly, controls: np.ndarray) -> np.ndarray:
        """Controls with the acceleration bounded by the rules' one."""
        most = float(guard.act(self._outlook.seen)[0])
        self._braked = bool(most < controls[0])
        return np.array([min(float(controls[0]), most), controls[1]])

    @property
    def _option(self) -> Manoeuvre | None:
        if self._conductor is None or self._conductor.option is None:
            return None
        return OPTIONS[self._conductor.option]

    def _chosen(self) -> Float32Array:
        """(2,) action of the running option, after a step of the master."""
        outlook, conductor = self._outlook, self._conductor
        assert conductor is not None
        assert self._master is not None
        q, beta, actions = parts(self._answer(outlook.vector()))
        self._prospect = OptionView(q, beta, outlook.available, outlook.finished, outlook.critical)
        if conductor.ends(self._prospect, 0.5):
            conductor.begin(self._prospect)
        conductor.tick()
        assert conductor.option is not None
        action: Float32Array = actions[conductor.option]
        return action

    def explain(self) -> Explanation | None:
        """Running option, values of all options, and the rules if they drive."""
        if self._outlook.seen == {}:
            return None
        out: Explanation = {"agent": self.spec.name, "arm": self._arm, "path_offset_m": round(self._outlook.offset, 2)}
        if self._prospect is not None and self._conductor is not None and self._option is not None:
            prospect = self._prospect
            out |= {
                "option": self._option.value,
                "option_s": round(0.1 * self._conductor.ticks, 1),
                "q": {name.value: round(float(v), 4) for name, v in zip(OPTIONS, prospect.q, strict=True)},
                "beta": {name.value: round(float(v), 4) for name, v in zip(OPTIONS, prospect.beta, strict=True)},
                "available": [name.value for name, may in zip(OPTIONS, prospect.available, strict=True) if may],
            }
        rules = self._outlook.rules
        if rules is not None:
            out["rules_drive"] = self._ruled
            out |= {
                **((rules.explain() or {}) if self._ruled else {}),
                "agent": self.spec.name,
                "rss": rules.judgement(),
            }
        if self._guard is not None:
            out |= {"rules_brake": self._braked, "rss": self._guard.judgement()}
        return out


def _shipped(arm: str) -> Path:
    """Shipped folder of an arm.

    Raises:
        InvalidInputError: None is shipped.
    """
    name = arm.removesuffix("-r").removesuffix("-s")
    folder, trainer = CHECKPOINT / name, FLAT if arm == FLAT else MASTER
    if not folder.is_dir():
        raise InvalidInputError(
            f"no checkpoint ships for arm '{arm}': train one by dohyo train hierarchical-{trainer} "
            f"--config agents/hierarchical/configs/{DRIVE if arm == FLAT else MASTER}.toml "
            f"--out runs/{name}/{trainer}, and give it by --set checkpoint=runs/{name}"
        )
    return folder
