"""Off-policy learning: step, store, update. An algorithm adds its networks, its exploration and its losses."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from typing import Annotated, Any, ClassVar, Generic, TypeVar, cast

import numpy as np
import torch
from gymnasium.spaces import Box, Discrete
from pydantic import Field
from tensordict import TensorDict, TensorDictBase
from torch import Tensor, nn

from dohyo.agents.learning.algorithms.divergence import check_actions, check_finite
from dohyo.agents.learning.experience.behaviour import DEMONSTRATOR, Act, Behaviour, PolicyBehaviour
from dohyo.agents.learning.experience.collector import Collector, Finished, outcome
from dohyo.agents.learning.experience.explorers import Explorers
from dohyo.agents.learning.experience.replay import Replay, ReplayConfig
from dohyo.agents.learning.files.metrics import Number
from dohyo.agents.learning.networks.modules import ObservationEncoder, evaluating
from dohyo.agents.learning.networks.vectors import ActionVector
from dohyo.agents.learning.policies.export import Exportable
from dohyo.agents.learning.runs.config import Positive, Share
from dohyo.agents.learning.runs.run import TaskRun
from dohyo.agents.learning.tasks.task import Array, Task, named
from dohyo.sumo_networks.config import Config
from dohyo.sumo_networks.errors import InvalidInputError

Augment = Callable[[TensorDictBase], TensorDictBase]
"""Changes a batch before it is learned from; its randomness comes from torch's global generator."""


class OffPolicyConfig(Config):
    """Settings of every off-policy learner.

    Attributes:
        replay: The table [replay].
        batch: Transitions per gradient step.
        gamma: Discount per step.
        updates_per_step: Gradient steps per environment step.
        learning_starts: Environment steps with random actions, before the first gradient step.
        demonstrated_share: Part of each batch that comes from the demonstrator (Ball et al. 2023: 0.5); 0: as it comes.
        round_steps: Steps of every environment in a round.
    """

    replay: ReplayConfig = ReplayConfig()
    batch: Positive = 256
    gamma: Share = 0.99
    updates_per_step: Annotated[float, Field(gt=0)] = 1.0
    learning_starts: Annotated[int, Field(ge=0)] = 100
    demonstrated_share: Share = 0.0
    round_steps: Positive = 1000


C = TypeVar("C", bound=OffPolicyConfig)


def make_replay(
    task: Task,
    run: TaskRun,
    config: OffPolicyConfig,
    rows: int,
    *,
    kind: Callable[..., Replay] = Replay,
    room_for_others: Callable[[int], int] = lambda steps: 0,
    **options: Any,
) -> Replay:
    """Replay in a run's folder, with slack for what two checkpoint intervals add.

    Args:
        task: What is learned.
        run: Its folder and configuration.
        config: Of the algorithm.
        rows: Of the collector.
        kind: Class of the replay.
        room_for_others: Entries that other producers add during a number of the collector's steps.
        options: `stack` and `extras` of `Replay`, and what its class needs.

    Raises:
        InvalidInputError: The disk has no room for the run's steps.
    """
    # A step adds one entry, or two where an episode begins; a checkpoint waits for the end of a round.
    steps = 2 * (run.config.checkpoint_every + rows * config.round_steps)
    slack = 2 * steps + room_for_others(steps)
    spaces = named(task.observation_space), task.action_space
    return kind(
        run.folder / "replay", spaces, config.replay, gamma=config.gamma, slack=slack, seed=run.config.seed,
        entries=run.config.steps, **options,
    )  # fmt: skip


class OffPolicy(ABC, Generic[C]):
    """Learner from replayed transitions.

    Attributes:
        encoder: Named observations -> (B, F); it acts in evaluation and learns in training.
        replay: Transitions of the run, and of any other producer.
        policy: Module that is shipped.
        updates: Gradient steps so far.
        steps: Environment steps when the present actions are chosen.
        columns: Of metrics.csv.
        losses: Names of what `learn` returns.
        actions: Kind of the action space.
        only_learns: Names of what explorers do without, beside optimisers.
    """

    losses: ClassVar[tuple[str, ...]]
    actions: ClassVar[type[Any]] = Box
    only_learns: ClassVar[tuple[str, ...]] = ("_collector", "replay", "_augment", "_behaviour")
    encoder: nn.Module
    replay: Replay
    policy: Exportable

    def __init__(
        self,
        task: Task,
        collector: Collector | Explorers,
        replay: Replay,
        config: C,
        device: torch.device,
        encoder: nn.Module | None = None,
        make_behaviour: Callable[[Act], Behaviour] = PolicyBehaviour,
        augment: Augment | None = None,
    ) -> None:
        """Draws weights from torch's generator.

        Args:
            task: What is learned; its actions are of the algorithm's kind.
            collector: Of the task, or explorers, which act by copies of this learner.
            replay: See `make_replay`.
            config: Settings.
            device: Of networks and batches.
            encoder: Named observations -> (B, `features`); None: vectors are joined.
            make_behaviour: From the exploring policy to what drives, such as a mixture with a demonstrator.
            augment: See `Augment`.

        Raises:
            InvalidInputError: The task's actions are of another kind, or a picture has no encoder.
        """
        self.check(task)
        self._collector, self.replay, self._device, self._augment = collector, replay, device, augment
        space: Any = task.action_space
        self._config, self._space = config, space
        self._behaviour = make_behaviour(self._choose)
        self._shares = {DEMONSTRATOR: config.demonstrated_share} if config.demonstrated_share else {}
        self._unit = ActionVector(space).to(device)
        self._due = 0.0  # gradient steps that are due
        self.steps = 0
        self.updates = 0
        self.encoder = (encoder or ObservationEncoder(named(task.observation_space))).to(device)
        self.build(int(self.encoder.features))  # type: ignore[arg-type]

    @abstractmethod
    def build(self, features: int) -> None:
        """Makes the networks on `features` numbers, their optimiser, and the policy that is shipped."""

    @classmethod
    def check(cls, task: Task) -> None:
        """Raises InvalidInputError if the task's actions are of another kind than the algorithm's."""
        if not isinstance(task.action_space, cls.actions):
            name, kind = cls.__name__, cls.actions.__name__
            raise InvalidInputError(f"{name}: expected actions in a {kind}, '{task.name}' has {task.action_space}")

    @property
    def columns(self) -> tuple[str, ...]:
        """See the class."""
        told = ("updates", "episodes", "return", "length", "success")
        return (*told, "demonstrated", "replay_demonstrated", *self.losses)

    @abstractmethod
    def explore(self, observation: TensorDictBase) -> dict[str, Tensor]:
        """(N,) observations -> "action" (N, ...) in the action space, with exploration, and what a behaviour reads."""

    @abstractmethod
    def learn(self, batch: TensorDictBase) -> dict[str, Tensor]:
        """One gradient step of each loss on (B,) transitions, see `Replay.sample`; what is logged, by name."""

    @property
    @abstractmethod
    def parts(self) -> Mapping[str, Any]:
        """Modules and optimisers that a checkpoint holds, by name."""

    def begin(self) -> None:
        """See `Learner`."""

    def round(self) -> dict[str, Number]:
        """Takes `round_steps` steps everywhere; environments in processes simulate while the learner updates.

        Raises:
            DohyoError: As from the collector; losses or actions are no longer finite.
        """
        sums: dict[str, Tensor] = {}
        before = self.updates
        for _ in self._collector.round(self._config.round_steps):
            self.steps = self._collector.steps
            self._collector.send(self._behaviour)
            self._update(sums)
            for step in self._collector.received():
                self.replay.add(step)
            if self._collector.steps > self._config.learning_starts:
                self._due += self._config.updates_per_step * (self._collector.steps - self.steps)
        means = {name: float(total) / (self.updates - before) for name, total in sums.items()}
        check_finite(means)
        row: dict[str, Number] = {"updates": self.updates, "episodes": self._collector.finished_count}
        finished = self._collector.finished()
        own = [episode for episode in finished if not episode.demonstrated]
        row |= self.shares(finished) if finished else {}
        row["replay_demonstrated"] = self.replay.share(DEMONSTRATOR)
        return row | outcome(own) | means

    def shares(self, episodes: Sequence[Finished]) -> dict[str, Number]:
        """Share of some episodes that the policy did not drive alone."""
        return {"demonstrated": sum(episode.demonstrated > 0.0 for episode in episodes) / len(episodes)}

    def _update(self, sums: dict[str, Tensor]) -> None:
        """Takes the gradient steps that are due, and adds their losses to the sums."""
        while self._due >= 1.0:
            batch: TensorDictBase = self.replay.sample(self._config.batch, self._shares)
            if self._device.type != "cpu":
                batch = batch.to(self._device)
            if self._augment is not None:
                batch = self._augment(batch)
            for name, value in self.learn(batch).items():
                sums[name] = sums[name] + value if name in sums else value
            self.updates += 1
            self._due -= 1.0

    def act(self, observation: TensorDict) -> Array:
        """See `Learner`."""
        with torch.no_grad(), evaluating(cast(nn.Module, self.policy)):
            actions = np.asarray(self.policy(observation.to(self._device)).cpu().numpy())
        check_actions(actions, observation)
        return actions

    def state(self) -> dict[str, Any]:
        """State for a checkpoint; the replay's frames stay where they are."""
        parts = {name: part.state_dict() for name, part in self.parts.items()}
        return {"parts": parts, "replay": self.replay.state(), "updates": self.updates, "due": self._due}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Restores a state.

        Raises:
            InvalidInputError: It holds other parts, since another version of the algorithm wrote it.
        """
        if state["parts"].keys() != self.parts.keys():
            raise InvalidInputError(
                f"checkpoint: expected {', '.join(self.parts)}, got {', '.join(state['parts'])}; train anew"
            )
        for name, part in self.parts.items():
            part.load_state_dict(state["parts"][name])
        self.replay.restore(state["replay"])
        self.updates, self._due = state["updates"], state["due"]

    def __getstate__(self) -> dict[str, Any]:
        """What acts: an explorer in another process has no collector, no replay and no optimiser, and cannot learn."""
        acting = {
            name: part
            for name, part in self.__dict__.items()
            if name not in self.only_learns and not isinstance(part, torch.optim.Optimizer)
        }
        return acting | {"_device": torch.device("cpu")}

    def _choose(self, observation: TensorDict) -> TensorDict:
        """Actions with exploration; random ones before the learning starts."""
        if self.steps < self._config.learning_starts:
            count = len(observation)
            if isinstance(self._space, Discrete):
                action = torch.randint(int(self._space.n), (count,))
            else:
                action = self._unit.inverse(2.0 * torch.rand(count, self._unit.size, device=self._device) - 1.0)
            chosen = {"action": action}
        else:
            with torch.no_grad(), evaluating(self.encoder):
                chosen = self.explore(observation.to(self._device) if self._device.type != "cpu" else observation)
        told = {name: value.cpu() for name, value in chosen.items()}
        check_actions(told["action"].numpy(), observation)
        return TensorDict(told, observation.batch_size)

    def _discount(self, batch: TensorDictBase) -> Tensor:
        """(B,) discounts of what follows the n steps of each return, 0 behind a terminal observation."""
        steps, follows = batch["next", "steps_to_next_obs"], ~batch["next", "terminated"]
        discount = self._config.gamma**steps if self._config.replay.steps > 1 else self._config.gamma
        discounts: Tensor = (follows * discount).squeeze(-1)
        return discounts


def linear(first: float, last: float, share: float) -> float:
    """Value at a share of the way from the first to the last one, which stays from a share of 1 on."""
    return first + min(1.0, share) * (last - first)


def weighted(errors: Tensor, batch: TensorDictBase) -> Tensor:
    """Mean of (..., B) errors, with the batch's importance weights if it has them."""
    weight = batch.get("weight", None)
    return errors.mean() if weight is None else (errors * weight).mean()
