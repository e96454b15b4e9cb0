"""LocalVectorEnv: environments that step one after the other, in this process."""

from __future__ import annotations

from typing import Any

import numpy as np

from dohyo.sumo_networks.envs.env_rows import EnvRows, RowArrays
from dohyo.sumo_networks.envs.row_vector_env import RowVectorEnv
from dohyo.sumo_networks.errors import SimulationError


class LocalVectorEnv(RowVectorEnv):
    """See `RowVectorEnv`. For fast environments, and for one that uses SUMO; several need processes."""

    def _take_arrays(self) -> RowArrays:
        arrays = {name: np.zeros(shape, dtype) for name, (dtype, shape) in self._plan.layout().items()}
        self._envs = [EnvRows(self._plan, arrays, rank) for rank in range(self._plan.groups)]
        self._sent: dict[int, tuple[str, tuple[Any, ...]]] = {}
        return RowArrays.of(arrays, self.single_observation_space)

    def _send(self, group: int, command: str, *arguments: Any) -> None:
        self._sent[group] = command, arguments

    def _receive(self, group: int) -> Any:
        command, arguments = self._sent.pop(group)
        try:
            return self._envs[group].carry_out(command, *arguments)
        except SystemExit as error:  # a worker's process would have ended
            raise SimulationError(f"environment {group} wanted to end the process with code {error.code}") from error

    def _discard(self, group: int) -> None:
        self._envs[group].close()

    def close_extras(self, **kwargs: Any) -> None:
        """Closes the environments; `close` calls it once."""
        for env in self._envs:
            env.close()
