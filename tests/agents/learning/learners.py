"""Off-policy learners on small tasks, without a run, and batches of random transitions."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import torch
from gymnasium.spaces import Discrete
from tensordict import TensorDict

from dohyo.agents.learning.algorithms.off_policy import OffPolicyConfig
from dohyo.agents.learning.experience.collector import Collector
from dohyo.agents.learning.experience.replay import Replay
from dohyo.agents.learning.tasks.task import Task, named


def learner(kind: Any, config: OffPolicyConfig, task: Task, folder: Path, **options: Any) -> Any:
    """A learner with two environments in this process."""
    torch.manual_seed(0)
    collector = Collector(task.make_environments(2, processes=False), task, seed=0)
    spaces = named(task.observation_space), task.action_space
    replay = Replay(folder / "replay", spaces, config.replay, gamma=config.gamma, slack=1000, seed=0)
    return kind(task, collector, replay, config, torch.device("cpu"), **options)


def transitions(task: Task, count: int, steps: int = 1) -> TensorDict:
    """(B,) random transitions, each third of which is terminal."""
    generator = torch.Generator().manual_seed(1)

    def seen() -> TensorDict:
        spaces = named(task.observation_space).spaces
        return TensorDict(
            {name: torch.randn(count, *box.shape, generator=generator) for name, box in spaces.items()}, [count]
        )

    space = task.action_space
    if isinstance(space, Discrete):
        action = torch.randint(int(space.n), (count,), generator=generator)
    else:
        low, high = torch.as_tensor(space.low), torch.as_tensor(space.high)
        action = low + (high - low) * torch.rand(count, *space.shape, generator=generator)
    terminated = (torch.arange(count) % 3 == 0)[:, None]
    after = {"reward": torch.randn(count, 1, generator=generator), "terminated": terminated, "done": terminated}
    after |= {"observation": seen(), "steps_to_next_obs": torch.full((count, 1), steps)}
    return TensorDict({"observation": seen(), "action": action, "index": torch.arange(count), "next": after}, [count])
