"""PolicyAgent: a driving agent of a trained policy, what it observes, and what its action means.

    class Mine(PolicyAgent):
        def __init__(self, policy: str = "runs/mine/best.onnx") -> None:
            super().__init__("mine", Path(policy), MyEncoder(), AsControl("target_speed_steering"), frames=3)

Training and driving share the encoder and the decoder: a task's environment calls `encode` on the observations of a
`DrivingEnv`, and passes `decode`'s result to it.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, Protocol

import numpy as np
from gymnasium.spaces import Box, Dict

from dohyo.agents.learning.policies.onnx_policy import OnnxPolicy
from dohyo.agents.learning.tasks.task import Array
from dohyo.evaluation.agent import Agent, AgentSpec, Explanation, Mission, Observation
from dohyo.sumo_networks.errors import InvalidInputError


class SensorEncoder(Protocol):
    """Turns an ego's sensors into what its policy observes. A subclass inherits the optional methods.

    Attributes:
        track: Track of the sensors.
        sensors: Names of the sensors that it reads.
        space: Of one result: float32 vectors (O,) and uint8 pictures (C, H, W) by name, as a task has it.
    """

    track: Literal["sensors", "map", "privileged"]
    sensors: tuple[str, ...]
    space: Dict

    @property
    def files(self) -> Sequence[str | Path]:
        """Files that decide its results, beside its code, such as a camera encoder's weights."""
        return ()

    def warm_up(self) -> None:
        """Compiles what `encode` calls; a call of `reset` follows."""
        return

    def reset(self, mission: Mission, seed: int) -> None:
        """Forgets the last episode."""
        return

    def encode(self, observation: Observation) -> dict[str, Array]:
        """What the policy observes; called once per tick, in the order of ticks."""
        ...


class ActionDecoder(Protocol):
    """Turns a policy's action into that of a control interface. A subclass inherits the optional method.

    Attributes:
        control: Name of the control interface.
    """

    control: str

    def reset(self) -> None:
        """Forgets the last episode."""
        return

    def decode(self, action: Array, observation: Observation) -> Array:
        """Action of the control interface; called once per tick, also while an action is repeated."""
        ...


class AsControl(ActionDecoder):
    """The policy's numbers are the control interface's."""

    def __init__(self, control: str) -> None:
        self.control = control

    def decode(self, action: Array, observation: Observation) -> Array:
        """See `ActionDecoder`."""
        return action


class Choices(ActionDecoder):
    """A discrete policy's number is a row of a table."""

    def __init__(self, control: str, table: Array) -> None:
        """Prepares.

        Args:
            control: Name of the control interface.
            table: (choices, A) actions of the control interface.
        """
        self.control, self._table = control, table

    def decode(self, action: Array, observation: Observation) -> Array:
        """See `ActionDecoder`."""
        return np.asarray(self._table[int(action)])


class PolicyAgent(Agent):
    """See the module.

    Attributes:
        files: Files that decide its actions, beside its code.
    """

    def __init__(
        self,
        name: str,
        policy: Path,
        encoder: SensorEncoder,
        decoder: ActionDecoder,
        *,
        frames: int = 1,
        action_repeat: int = 1,
    ) -> None:
        """Reads the policy.

        Args:
            name: Of the agent.
            policy: ONNX file of a run, such as best.onnx.
            encoder: Of the policy's observations.
            decoder: Of its actions.
            frames: Pictures in a stack, as `environments.FrameStack` makes it.
            action_repeat: Ticks of every decision, as with `environments.ActionRepeat`.

        Raises:
            InvalidInputError: There is no such policy, or it needs other observations.
        """
        if frames < 1 or action_repeat < 1:
            raise InvalidInputError(f"expected at least 1 frame and tick, got {frames} and {action_repeat}")
        self._policy, self._encoder, self._decoder = OnnxPolicy(policy), encoder, decoder
        self._frames = Frames(encoder.space, frames)
        self._policy.check(self._frames.space)
        self._action_repeat = action_repeat
        self.files = (policy, *encoder.files)
        self.spec = AgentSpec(name=name, track=encoder.track, sensors=encoder.sensors, control=decoder.control)
        self._action: Array | None = None
        self._ticks = 0

    def warm_up(self) -> None:
        """Compiles the encoder, and decides once on zeros."""
        self._encoder.warm_up()
        self._policy({name: np.zeros(shape, dtype) for name, (shape, dtype) in self._policy.inputs.items()})

    def reset(self, mission: Mission, seed: int) -> None:
        """Forgets the last episode."""
        self._encoder.reset(mission, seed)
        self._decoder.reset()
        self._frames.clear()
        self._action, self._ticks = None, 0

    def act(self, observation: Observation) -> Array:
        """Decides, or repeats the last decision."""
        encoded = self._encoder.encode(observation)
        if self._action is None or self._ticks % self._action_repeat == 0:
            self._action = self._policy(self._frames.stacked(encoded))
        self._ticks += 1
        return self._decoder.decode(self._action, observation)

    def explain(self) -> Explanation | None:
        """The policy's own action."""
        return None if self._action is None else {"agent": self.spec.name, "policy_action": self._action.tolist()}


class Frames:
    """Stack of the last pictures along their channels; an episode's first picture is repeated. Vectors stay.

    Attributes:
        space: Of the stacked observations.
    """

    def __init__(self, space: Dict, count: int) -> None:
        """Prepares.

        Args:
            space: Of one observation.
            count: Pictures in a stack.
        """
        self._count = count
        self._pictures: dict[str, deque[Array]] = {
            name: deque(maxlen=count) for name, one in space.spaces.items() if len(one.shape or ()) == 3
        }
        self.space = Dict({name: self._stacked_space(name, one) for name, one in space.spaces.items()})

    def clear(self) -> None:
        """Forgets all pictures."""
        for pictures in self._pictures.values():
            pictures.clear()

    def stacked(self, observation: Mapping[str, Array]) -> dict[str, Array]:
        """The observation with its pictures in place of the oldest ones."""
        out = dict(observation)
        for name, pictures in self._pictures.items():
            pictures.extend([observation[name]] * (1 if pictures else self._count))
            out[name] = np.concatenate(pictures)
        return out

    def _stacked_space(self, name: str, space: Any) -> Any:
        if name not in self._pictures:
            return space
        low, high = (np.tile(bound, (self._count, 1, 1)) for bound in (space.low, space.high))
        return Box(low, high, dtype=space.dtype)
