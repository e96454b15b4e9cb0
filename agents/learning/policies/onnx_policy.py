"""An exported policy as a function of one observation, in ONNX Runtime on one thread."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium.spaces import Box, Dict, Discrete

from dohyo.agents.learning.policies.export import ACTION
from dohyo.agents.learning.policies.session import session_from
from dohyo.agents.learning.tasks.task import Array
from dohyo.sumo_networks.errors import InvalidInputError

TYPES: dict[str, np.dtype[Any]] = {"tensor(float)": np.dtype(np.float32), "tensor(uint8)": np.dtype(np.uint8)}


class OnnxPolicy:
    """What `export` wrote: observations by name -> an action in the action space.

    Attributes:
        inputs: Shape and type of each observation that it uses, by name.
        path: Of the file.
    """

    def __init__(self, path: Path) -> None:
        """Reads the model.

        Raises:
            InvalidInputError: The file is missing, or no policy of named observations.
        """
        self._session = session_from(path, "policy")
        self.path = path
        self.inputs: dict[str, tuple[tuple[int, ...], np.dtype[Any]]] = {}
        for one in self._session.get_inputs():
            if one.type not in TYPES:
                raise InvalidInputError(f"policy '{path}': expected float32 or uint8 as '{one.name}', got {one.type}")
            self.inputs[one.name] = (tuple(one.shape[1:]), TYPES[one.type])
        outputs = [one.name for one in self._session.get_outputs()]
        if outputs != [ACTION]:
            raise InvalidInputError(f"policy '{path}': expected the output '{ACTION}', got {', '.join(outputs)}")

    def check(self, space: Dict) -> None:
        """Raises InvalidInputError if observations of a space have not all that the policy needs."""
        for name, (shape, dtype) in self.inputs.items():
            given = space.spaces.get(name)
            if given is None:
                raise InvalidInputError(
                    f"policy '{self.path}' needs the observation '{name}', there is {', '.join(space.spaces)}"
                )
            if (given.shape, given.dtype) != (shape, dtype):
                raise InvalidInputError(
                    f"policy '{self.path}': expected observation '{name}' to be {dtype} {shape}, got {given.dtype} "
                    f"{given.shape}"
                )

    def check_actions(self, space: Box | Discrete) -> None:
        """Raises InvalidInputError if a decision on zeros is no action of a space."""
        action = self({name: np.zeros(shape, dtype) for name, (shape, dtype) in self.inputs.items()})
        discrete = np.issubdtype(action.dtype, np.integer)
        if action.shape != space.shape or discrete != isinstance(space, Discrete):
            raise InvalidInputError(
                f"policy '{self.path}': expected actions of {space}, got {action.dtype} {action.shape}"
            )
        if not np.isfinite(action).all():
            raise InvalidInputError(f"policy '{self.path}': expected finite actions, got {action.tolist()}")

    def __call__(self, observation: Mapping[str, Array]) -> Array:
        """One observation -> its action, (A,) float32 or () int64; observations that it does not use are ignored."""
        return np.asarray(self.of_batch({name: observation[name][None] for name in self.inputs})[0])

    def of_batch(self, observations: Mapping[str, Array]) -> Array:
        """(N, ...) observations -> (N, A) float32 or (N,) int64 actions."""
        (actions,) = self._session.run([ACTION], {name: observations[name] for name in self.inputs})
        return np.asarray(actions)
