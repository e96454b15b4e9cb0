"""TorchRL on top of VectorDrivingEnv; a module of its own, so that workers need not load torch."""

from __future__ import annotations

from typing import Any

import torch
from gymnasium.spaces import Box, Dict
from gymnasium.vector import AutoresetMode
from tensordict import TensorDict, TensorDictBase
from torchrl.data import Bounded, Categorical, Composite, TensorSpec, Unbounded
from torchrl.data.utils import numpy_to_torch_dtype_dict
from torchrl.envs import EnvBase

from dohyo.sumo_networks.envs.env_rows import Observations
from dohyo.sumo_networks.envs.options import DEFAULT_SENSORS, SensorNames
from dohyo.sumo_networks.envs.scenario_env import ScenarioSource
from dohyo.sumo_networks.envs.vector_env import VectorDrivingEnv

ENDS = ("done", "terminated", "truncated")


def make_torchrl_env(
    scenarios: ScenarioSource,
    num_envs: int,
    sensors: SensorNames = DEFAULT_SENSORS,
    control: str = "target_speed_steering",
    reward: str | None = "roach",
    seed: int = 0,
) -> TorchDrivingEnv:
    """Makes an environment for TorchRL's collectors and losses; arguments as for `VectorDrivingEnv`.

    Args:
        scenarios: Scenarios to drive.
        num_envs: Number of environments, one process each.
        sensors: Sensors of all egos.
        control: Control interface of all egos.
        reward: Reward function of all egos.
        seed: Seed of the run.
    """
    vector = VectorDrivingEnv(scenarios, num_envs, sensors, control, reward, AutoresetMode.DISABLED)
    return TorchDrivingEnv(vector, seed)


class TorchDrivingEnv(EnvBase):  # type: ignore[misc]
    """A VectorDrivingEnv of N environments with batch size (N,), on the CPU.

    With one ego, the keys are the sensors' names, "action" (N, ...), "reward", "done", "terminated" and "truncated"
    (N, 1). With E > 1 egos, all these are under "agents" with shape (N, E, ...), and "mask" (N, E) is True for egos
    that drive in the next step. At the root, "done" (N, 1) is then True when the last ego's episode has ended, and
    "terminated" when all have terminated.

    Source: TorchRL's EnvBase, and its PettingZooWrapper for the names with many egos.
    """

    def __init__(self, vector: VectorDrivingEnv, seed: int = 0) -> None:
        """Wraps a VectorDrivingEnv.

        Args:
            vector: Environments with AutoresetMode.DISABLED, since TorchRL resets them; closed with this environment.
            seed: Seed of the run.
        """
        super().__init__(device=torch.device("cpu"), batch_size=torch.Size([vector.num_envs]))
        self._vector, self._seed, self._fresh = vector, seed, True
        self._many = vector.num_egos > 1
        self._rows = torch.Size([*self.batch_size, vector.num_egos]) if self._many else self.batch_size
        self._terminated = torch.zeros(*self._rows, 1, dtype=torch.bool)
        self._truncated = self._terminated.clone()
        self._make_specs()

    def _make_specs(self) -> None:
        sensors, actions = self._vector.observation_space, self._vector.action_space
        assert isinstance(sensors, Dict)
        assert isinstance(actions, Box)
        observations: dict[str, TensorSpec] = {
            name: Unbounded(torch.Size(box.shape or ()), dtype=numpy_to_torch_dtype_dict[box.dtype])
            for name, box in sensors.spaces.items()
        }
        if self._many:
            observations["mask"] = _flag(self._rows)
        low, high = torch.as_tensor(actions.low), torch.as_tensor(actions.high)
        self.observation_spec = self._nested(observations)
        self.action_spec = self._nested({"action": Bounded(low, high, torch.Size(actions.shape), dtype=torch.float32)})
        self.reward_spec = self._nested({"reward": Unbounded(self._terminated.shape)})
        done = self._nested({name: _flag(self._terminated.shape) for name in ENDS})
        for name in ENDS:
            done[name] = _flag(torch.Size([*self.batch_size, 1]))
        self.done_spec = done

    def _nested(self, specs: dict[str, TensorSpec]) -> Composite:
        inner = Composite(specs, shape=self._rows)
        return Composite({"agents": inner}, shape=self.batch_size) if self._many else inner

    def _set_seed(self, seed: int | None) -> None:
        self._seed, self._fresh = seed or 0, True

    def _reset(self, tensordict: TensorDictBase | None = None, **kwargs: Any) -> TensorDictBase:
        wanted = None if tensordict is None else tensordict.get("_reset", None)
        mask = torch.ones(self.batch_size, dtype=torch.bool) if wanted is None else wanted.reshape(self.batch_size)
        observations, _ = self._vector.reset(
            seed=self._seed if self._fresh else None, options={"reset_mask": mask.numpy()}
        )
        self._fresh = False
        self._terminated[mask], self._truncated[mask] = False, False
        return self._as_tensordict(observations)

    def _step(self, tensordict: TensorDictBase) -> TensorDictBase:
        action = tensordict.get(("agents", "action") if self._many else "action")
        observations, rewards, terminations, truncations, _ = self._vector.step(action.numpy())
        # An ego whose episode has ended stays done until all are reset.
        self._terminated |= torch.from_numpy(terminations).unsqueeze(-1)
        self._truncated |= torch.from_numpy(truncations).unsqueeze(-1)
        return self._as_tensordict(observations, torch.from_numpy(rewards).float().unsqueeze(-1))

    def _as_tensordict(self, observations: Observations, reward: torch.Tensor | None = None) -> TensorDictBase:
        values = {name: torch.from_numpy(array) for name, array in observations.items()}
        terminated, truncated = self._terminated.clone(), self._truncated.clone()
        ended = terminated | truncated
        values |= {"terminated": terminated, "truncated": truncated, "done": ended}
        if reward is not None:
            values["reward"] = reward
        if not self._many:
            return TensorDict(values, self.batch_size)
        values["mask"] = ~ended.squeeze(-1)
        all_ended, all_terminated = ended.all(dim=1), terminated.all(dim=1)
        root = {"terminated": all_terminated, "truncated": all_ended & ~all_terminated, "done": all_ended}
        return TensorDict({"agents": TensorDict(values, self._rows), **root}, self.batch_size)

    def close(self, *, raise_if_closed: bool = True) -> None:
        """Ends the processes."""
        self._vector.close()
        super().close(raise_if_closed=raise_if_closed)


def _flag(shape: torch.Size) -> Categorical:
    return Categorical(2, shape=shape, dtype=torch.bool)
