"""Behavioural cloning: a policy learns an expert's recorded actions by supervised learning."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import closing
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

import numpy as np
import torch
from pydantic import Field
from tensordict import TensorDict, TensorDictBase
from torch import Tensor, nn

from dohyo.agents.learning.experience.demonstrations import Demonstrations
from dohyo.agents.learning.files.report import Report
from dohyo.agents.learning.networks.modules import ObservationEncoder
from dohyo.agents.learning.networks.policy import Actor, EncodedPolicy, PpoActor, actor_for, distribution_at
from dohyo.agents.learning.policies.exact_export import export_exact
from dohyo.agents.learning.runs.config import Positive
from dohyo.agents.learning.runs.evaluation import evaluate
from dohyo.agents.learning.runs.run import Run
from dohyo.agents.learning.runs.supervised import FREE, Cosine, Fit, SupervisedConfig, fit, shuffled
from dohyo.agents.learning.runs.trainer import Trainer, TrainRequest
from dohyo.agents.learning.tasks.task import Array, Task, check_task, named
from dohyo.sumo_networks.config import Config
from dohyo.sumo_networks.errors import InvalidInputError

HUBER_BETA = 0.1
"""Error, in [-1, 1]^A, from which Huber's loss is linear."""
Loss = Literal["likelihood", "huber"]


class PolicyConfig(Config):
    """Settings of an imitating policy and its loss.

    Attributes:
        loss: "likelihood": minus the mean log-probability of the expert's action; "huber": Huber's loss of the mean
            action in [-1, 1]^A, for Gaussians whose deviation does not depend on the observation.
        hidden: Width of each hidden layer.
        initial_std: Standard deviation of the actions at the start, where the action space is [-1, 1].
        squashed: Whether actions are squashed by tanh, with a deviation that depends on the observation.
    """

    loss: Loss = "likelihood"
    hidden: Annotated[tuple[Positive, ...], Field(min_length=1)] = (256, 256)
    initial_std: Annotated[float, Field(gt=0)] = 0.5
    squashed: bool = False


def cloning_loss(actor: PpoActor, features: Tensor, actions: Tensor, loss: Loss) -> Tensor:
    """Mean loss of a policy at an expert's actions.

    Args:
        actor: The policy.
        features: (B, O) that it sees.
        actions: (B, ...) of the expert, in the action space.
        loss: See `PolicyConfig`.
    """
    wanted = actor.variable_of(actions)
    if loss == "huber":
        assert isinstance(actor, Actor)
        return nn.functional.smooth_l1_loss(actor.gaussian(features)[0], wanted, beta=HUBER_BETA)
    likelihood: Tensor = distribution_at(actor, features).log_prob(wanted).mean()
    return -likelihood


class Labels:
    """All labelled steps so far.

    Attributes:
        rows: "observation" by name, "label" (the expert's actions), and what else was added with them; (B,).
    """

    def __init__(self) -> None:
        self.rows = TensorDict({}, [0])

    def __len__(self) -> int:
        return len(self.rows)

    def add(self, steps: TensorDictBase, **more: Tensor) -> TensorDictBase:
        """Adds the labelled rows of (N, T) steps, in the order of time, with (N, T) values of other names.

        Returns:
            The (B,) rows that are new.
        """
        names = ("observation", "label")
        kept = TensorDict({**{name: steps[name] for name in names}, **more}, steps.batch_size)
        new = kept.transpose(0, 1)[steps["labelled"].transpose(0, 1)]
        self.rows = TensorDict.cat([self.rows, new]) if len(self.rows) else new
        return new

    def fit(
        self, optimizer: torch.optim.Optimizer, loss: Callable[[TensorDictBase], Tensor], passes: int, batch: int
    ) -> float:
        """Takes gradient steps over several passes; returns the last pass's mean loss."""
        mean = 0.0
        for _ in range(passes):
            losses = []
            for rows in torch.split(torch.randperm(len(self)), batch):
                value = loss(self.rows[rows])
                optimizer.zero_grad(set_to_none=True)
                value.backward()  # type: ignore[no-untyped-call]
                optimizer.step()
                losses.append(value.item())
            mean = sum(losses) / len(losses)
        return mean


class ImitatingPolicy(nn.Module):
    """Encoder and actor that learn an expert's actions.

    Attributes:
        encoder: Named observations -> features.
        actor: Features -> actions.
        exported: The policy on named observations, which is shipped.
    """

    def __init__(self, task: Task, config: PolicyConfig, encoder: nn.Module | None = None) -> None:
        """Draws weights from torch's generator.

        Args:
            task: Gives the spaces.
            config: Settings.
            encoder: With an attribute `features`, their number; None: vectors are joined.

        Raises:
            InvalidInputError: A picture without an encoder, or settings that do not fit the action space.
        """
        super().__init__()
        space = named(task.observation_space)
        self._names, self._loss = list(space.spaces), config.loss
        self.encoder = encoder or ObservationEncoder(space)
        features: int = self.encoder.features  # type: ignore[assignment]
        self.actor: Any = actor_for(features, task.action_space, config.hidden, config.initial_std, config.squashed)
        self.exported: Any = self.actor if encoder is None else EncodedPolicy(self.encoder, self.actor)
        if config.loss == "huber" and not isinstance(self.actor, Actor):
            raise InvalidInputError('expected loss = "likelihood" with squashed or discrete actions, got "huber"')

    @property
    def device(self) -> torch.device:
        """Device of the weights."""
        return next(self.actor.parameters()).device  # type: ignore[no-any-return]

    def features(self, observation: TensorDictBase) -> Tensor:
        """Named observations (B, *) -> (B, O)."""
        features: Tensor = self.encoder({name: observation[name].to(self.device) for name in self._names})
        return features

    def loss(self, observation: TensorDictBase, actions: Tensor) -> Tensor:
        """Mean loss at the expert's (B, ...) actions."""
        return cloning_loss(self.actor, self.features(observation), actions.to(self.device), self._loss)

    @torch.no_grad()
    def act(self, observation: TensorDict) -> Array:
        """See `Learner`."""
        return np.asarray(self.actor(self.features(observation)).cpu().numpy())


class CloningConfig(SupervisedConfig):
    """A run of behavioural cloning, on a folder of demonstrations.

    Attributes:
        policy: The policy and its loss, the table [policy].
        steps: Gradient steps.
        batch: Transitions in each.
        learning_rate: Of AdamW, at the start; it falls to zero along a cosine.
        weight_decay: Of AdamW.
        held_out_share: Part of the demonstrated episodes, the last ones, that only measure the loss.
        evaluate_every: Gradient steps between two drives of the task's held-out episodes.
    """

    policy: PolicyConfig = PolicyConfig()
    steps: Positive = 10_000
    batch: Positive = 128
    learning_rate: Annotated[float, Field(gt=0)] = 1e-3
    weight_decay: Annotated[float, Field(ge=0)] = 1e-4
    held_out_share: Annotated[float, Field(gt=0, lt=1)] = 0.1
    evaluate_every: Positive = 2_000


C = TypeVar("C", bound=CloningConfig)
MEASURES = ("held_out_loss", "return", "success")


def cloning_trainer(summary: str, config: type[C], task_of: Callable[[C], Task]) -> Trainer[C]:
    """A trainer that clones the demonstrations of a task.

    Args:
        summary: Subject, in a few words.
        config: Its settings.
        task_of: The task of some settings.
    """

    def train(settings: C, order: TrainRequest) -> Path:
        with closing(Run(order.name, order.out, settings, order.resume, FREE)) as run:
            task = task_of(settings)
            policy, measures = _clone(task, run, lambda step, row: order.report(_report(settings, step, row)))
            facts = {"trainer": run.trainer, "task": task.name, "steps": str(settings.steps)}
            spaces = named(task.observation_space), task.action_space
            export_exact(policy.exported, spaces, run.folder / "policy", facts)
            run.write_card("policy", task.name, settings.steps, measures, settings.data)
        return run.folder / "policy.safetensors"

    return Trainer(summary, config, train)


def _clone(
    task: Task, run: Run[CloningConfig], progress: Callable[[int, Mapping[str, float]], None]
) -> tuple[ImitatingPolicy, Mapping[str, float]]:
    """The policy, and the last validation's measures.

    Open-loop loss does not predict how a policy drives; so validations drive the task's held-out episodes, too.
    """
    config = run.config
    check_task(task)
    torch.set_num_threads(1)
    torch.manual_seed(config.seed)
    shown = Demonstrations(config.data)
    shown.check(task)
    learned, held_out = shown.split(config.held_out_share)
    policy = ImitatingPolicy(task, config.policy).to(run.device)
    environments = task.make_environments(task.judged_at_once, processes=task.alone)

    def validate() -> dict[str, float]:
        with torch.no_grad():
            loss = policy.loss(held_out["observation"], held_out["action"]).item()
        driven = evaluate(task, environments, policy.act)
        return {
            "held_out_loss": loss,
            "return": driven.mean_return.mean or 0.0,
            "success": driven.success.mean or 0.0,
        }

    job = Fit(
        network=policy,
        optimizer=torch.optim.AdamW(policy.parameters(), config.learning_rate, weight_decay=config.weight_decay),
        losses=lambda rows: {"loss": policy.loss(learned["observation"][rows], learned["action"][rows])},
        batches=shuffled(len(learned), config.batch, config.seed),
        rate=Cosine(config.learning_rate, config.steps),
        steps=config.steps,
        validate=validate,
        validate_every=config.evaluate_every,
        columns=("loss", *MEASURES),
    )
    try:
        return policy, fit(job, run, progress)
    finally:
        environments.close()


def _report(config: CloningConfig, step: int, row: Mapping[str, float]) -> Report:
    return Report(step, config.steps, row["loss"], "loss")
