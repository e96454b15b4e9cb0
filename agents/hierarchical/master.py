"""Master: network that chooses among the sub-policies and terminates them; it contains them."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

import torch
from safetensors import SafetensorError, safe_open
from torch import Tensor, nn

from dohyo.agents.hierarchical.hierarchy import SubPolicies
from dohyo.agents.hierarchical.options.actuation import ACTIONS, Steering
from dohyo.agents.hierarchical.options.executor import OptionLimits
from dohyo.agents.hierarchical.options.manoeuvres import Manoeuvre
from dohyo.agents.hierarchical.options.values import OptionValues
from dohyo.agents.hierarchical.state.master_observation import FLAGS, OPTIONS
from dohyo.agents.hierarchical.state.state import StateConfig, StateEncoder
from dohyo.agents.learning.networks.policy import Actor, Named, joined
from dohyo.sumo_networks.arrays import BoolArray, Float32Array
from dohyo.sumo_networks.config import Config
from dohyo.sumo_networks.errors import InvalidInputError

SHAPE, MANNER = "shape", "manner"


class MasterSpec(Config):
    """Settings that a master must be driven with.

    Attributes:
        state: What it sees.
        steering: Of its sub-policies.
        tempo: Duration of its options.
    """

    state: StateConfig = StateConfig()
    steering: Steering = Steering.POLICY
    tempo: OptionLimits = OptionLimits()


class Master(nn.Module):
    """MasterObservation -> Q_Omega, beta, and the action of each option.

    Attributes:
        values: Q_Omega and beta of the state.
        actors: The options' policies, by `Manoeuvre`.
        size: Numbers in a state.
        hidden: Width of each hidden layer of `values`.
        manner: What it must be driven with.
    """

    def __init__(
        self,
        size: int,
        hidden: Sequence[int],
        actors: Mapping[str, Actor],
        rows: Mapping[str, Tensor],
        manner: MasterSpec,
    ) -> None:
        """Makes the networks.

        Args:
            size: Numbers in a state.
            hidden: Width of each hidden layer.
            actors: By `Manoeuvre`.
            rows: Indices of the numbers of a state that each sees.
            manner: What it must be driven with.
        """
        super().__init__()
        self.size, self.hidden, self.manner = size, tuple(hidden), manner
        self.values = OptionValues(size, len(OPTIONS), hidden)
        self.actors = nn.ModuleDict({name: actors[name] for name in OPTIONS})
        for name in OPTIONS:
            self.register_buffer(f"rows_{name}", rows[name])

    def forward(self, observation: Tensor | Named) -> Tensor:
        """(B, size + options + FLAGS) vectors -> (B, 4 * options): Q, beta, pedals and steering of each."""
        outlook = joined(observation)
        state = outlook[:, : self.size]
        q, beta = self.values(state)
        actions = [self.actor(name)(self.view(name, state)) for name in OPTIONS]
        return torch.cat([q, beta, *actions], dim=1)

    def actor(self, option: Manoeuvre) -> Actor:
        """The policy of an option."""
        actor = self.actors[option]
        assert isinstance(actor, Actor)
        return actor

    def view(self, option: Manoeuvre, state: Tensor) -> Tensor:
        """(B, size) -> the part that an option's policy sees."""
        rows = self.get_buffer(f"rows_{option}")
        return state[:, rows]

    def facts(self) -> Mapping[str, str]:
        """Arguments that `read_master` needs beside the weights."""
        sizes = {name: self.actor(name).sizes for name in OPTIONS}
        shape = json.dumps({"size": self.size, "hidden": self.hidden, "actors": sizes})
        return {SHAPE: shape, MANNER: self.manner.model_dump_json()}


def master_of(policies: SubPolicies, hidden: Sequence[int], tempo: OptionLimits) -> Master:
    """An untrained master over trained sub-policies."""
    size = StateEncoder(policies.state).size
    actors = {name: policy.actor for name, policy in policies.policies.items()}
    rows = {name: policy.rows for name, policy in policies.policies.items()}
    manner = MasterSpec(state=policies.state, steering=policies.steering, tempo=tempo)
    return Master(size, hidden, actors, rows, manner)


def read_master(path: Path) -> Master:
    """A trained master.

    Raises:
        InvalidInputError: The file is missing or damaged, or holds no master.
    """
    try:
        with safe_open(path, framework="pt") as file:
            facts = file.metadata() or {}
            weights = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 - no mapping
        shape, manner = json.loads(facts[SHAPE]), MasterSpec.model_validate_json(facts[MANNER])
        actors, rows = {}, {}
        for name, (observations, *hidden, _) in shape["actors"].items():
            low, high = weights[f"actors.{name}.low"], weights[f"actors.{name}.high"]
            actors[name], rows[name] = Actor(observations, low, high, hidden), weights[f"rows_{name}"]
        master = Master(shape["size"], shape["hidden"], actors, rows, manner)
        master.load_state_dict(weights)
    except FileNotFoundError as error:
        raise InvalidInputError(f"no master '{path}'") from error
    except (OSError, SafetensorError, KeyError, TypeError, ValueError, RuntimeError) as error:
        raise InvalidInputError(f"'{path}' is no master: {str(error).splitlines()[0]}") from error
    return master.eval()


class MasterView:
    """Parts of one outlook.

    Attributes:
        state: (size,).
        available: (options,) options that may begin.
        finished: Whether the running option has reached its goal.
        critical: Whether the rules drive.
        fresh: Whether this is the first outlook of its episode.
    """

    def __init__(self, vector: Float32Array, size: int) -> None:
        """Splits `MasterObservation.vector`."""
        self.state = vector[:size]
        self.available: BoolArray = vector[size : size + len(OPTIONS)] > 0.5
        flags = vector[size + len(OPTIONS) :] > 0.5
        assert len(flags) == FLAGS
        self.finished, self.critical, self.fresh = (bool(flag) for flag in flags)


def parts(answer: Float32Array) -> tuple[Float32Array, Float32Array, Float32Array]:
    """Q (options,), beta (options,) and actions (options, 2) of one output of `Master`."""
    count = len(OPTIONS)
    return answer[:count], answer[count : 2 * count], answer[2 * count :].reshape(count, ACTIONS)
