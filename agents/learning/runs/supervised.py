"""Supervised learning: one loop for every network that learns from a data set.

The rows of a batch and the learning rate follow from the number of the step. A training that was killed and resumed
therefore ends with the same weights as one that was not.
"""

from __future__ import annotations

import copy
import hashlib
import math
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import nullcontext
from dataclasses import dataclass
from itertools import count, islice
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import torch
from pydantic import Field
from torch import Tensor, nn

from dohyo.agents.learning.files.card import digest
from dohyo.agents.learning.files.checkpoint import random_state, restore_random_state
from dohyo.agents.learning.runs.config import BaseRunConfig
from dohyo.agents.learning.runs.run import Run, RunStoppedError, Stop
from dohyo.sumo_networks.errors import InvalidInputError

FREE = frozenset({"checkpoint_s", "tensorboard"})
"""Settings that decide no weight, and may change when a training is resumed."""
LOG_EVERY = 10
"""Steps between two rows of metrics.csv."""
SPLITS = ("train", "validation")
"""Parts of a data set that a training reads; beside them may lie others, and caches."""

Batches = Callable[[int], Iterator[Tensor]]
"""Numbers of the rows of each batch, from a step on."""
Progress = Callable[[int, Mapping[str, float]], None]
"""Called with every step and its values: the loss, its parts, and the measures if the network was validated."""


class SupervisedConfig(BaseRunConfig):
    """Settings of every training on a data set.

    Attributes:
        data: Folder of the data set.
        checkpoint_s: Wall-clock time between two checkpoints, s.
    """

    data: Path
    checkpoint_s: Annotated[float, Field(gt=0)] = 300.0


class Rate:
    """Learning rate over the steps. A rate that reacts to validations overrides all methods."""

    def at(self, step: int) -> float | None:
        """Rate of the update after some steps; None: the training is over."""
        raise NotImplementedError

    def validated(self, step: int, better: bool) -> None:
        """Told after every validation whether its first measure is the lowest so far."""

    def state(self) -> dict[str, Any]:
        """State for `restore`, as plain values."""
        return {}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Restores a state."""


@dataclass(frozen=True, slots=True)
class Cosine(Rate):
    """Rises over a warm-up, stays, then falls to zero along a cosine.

    Attributes:
        highest: Rate after the warm-up.
        steps: At which it is zero.
        warm_up: Steps over which it rises.
        falls_from: The first step of the fall; None: the end of the warm-up.
    """

    highest: float
    steps: int
    warm_up: int = 0
    falls_from: int | None = None

    def at(self, step: int) -> float:
        """See `Rate`."""
        if step < self.warm_up:
            return self.highest * (step + 1) / self.warm_up
        first = self.warm_up if self.falls_from is None else self.falls_from
        share = max(step - first, 0) / max(self.steps - first, 1)
        return 0.5 * self.highest * (1.0 + math.cos(math.pi * share))


def shuffled(size: int, batch: int, seed: int) -> Batches:
    """Every epoch has every row once, in its own order; a last, incomplete batch is left out.

    Args:
        size: Rows of the data set.
        batch: Rows of a batch; all of them if there are fewer.
        seed: Of the orders.
    """
    batch = min(batch, size)

    def batches(first: int) -> Iterator[Tensor]:
        for epoch in count(first // (size // batch)):
            order = torch.from_numpy(np.random.default_rng([seed, epoch]).permutation(size))
            places = range(size // batch)
            yield from (order[at * batch : (at + 1) * batch] for at in places if epoch * len(places) + at >= first)

    return batches


def drawn(size: int, batch: int, seed: int) -> Batches:
    """Rows of a data set, drawn with replacement."""

    def batches(first: int) -> Iterator[Tensor]:
        rng = np.random.default_rng(seed)
        return islice((torch.from_numpy(rng.integers(0, size, batch)) for _ in count()), first, None)

    return batches


@dataclass(frozen=True, slots=True, kw_only=True)
class Fit:
    """A network, and how it is fitted to a data set.

    Attributes:
        network: Learns.
        optimizer: Of the parameters that change.
        losses: Rows of the data set -> the total "loss", and its parts.
        batches: Order of the rows.
        rate: Learning rate.
        steps: Updates, at most.
        validate: Measures of the network on held-out rows, without randomness; of the first one, lower is better.
        validate_every: Steps between two validations; there is one at the end, too.
        gradient_norm: Upper bound; None: none.
        keeps_best: Whether the network ends with the weights of its best validation; the first one is before any step.
        columns: Names of losses and measures, for metrics.csv.
    """

    network: nn.Module
    optimizer: torch.optim.Optimizer
    losses: Callable[[Tensor], Mapping[str, Tensor]]
    batches: Batches
    rate: Rate
    steps: int
    validate: Callable[[], Mapping[str, float]] = dict
    validate_every: int = 1_000_000
    gradient_norm: float | None = None
    keeps_best: bool = False
    columns: tuple[str, ...] = ("loss",)


def fit(
    job: Fit, run: Run[SupervisedConfig] | None = None, progress: Progress = lambda step, row: None
) -> Mapping[str, float]:
    """Fits a network, from its run's checkpoint if there is one.

    Args:
        job: The network, its data, and the manner.
        run: Gets metrics.csv, timing.csv and checkpoints; None: nothing is written.
        progress: Called after every step.

    Returns:
        The last validation's measures.

    Raises:
        InvalidInputError: The run's data are others than those of its checkpoint.
        RunStoppedError: After SIGINT or SIGTERM; a checkpoint is written.
    """
    session, stop = _Session(job, run), Stop()
    with nullcontext() if run is None else stop.listening():
        for rows in job.batches(session.step):
            rate = job.rate.at(session.step)
            if session.step >= job.steps or rate is None:
                break
            row = session.update(rows, rate)
            judged = session.step % job.validate_every == 0 or session.step == job.steps
            if judged:
                row |= session.judge()
            progress(session.step, row)
            session.log(row, judged)
            if stop.requested and session.step < job.steps:
                session.save()
                raise RunStoppedError(f"stopped at step {session.step} of {job.steps}; the checkpoint is written")
    session.save()
    if job.keeps_best:
        job.network.load_state_dict(session.best_weights)
    return session.measures


class _Session:
    """A training in its present state, as a checkpoint holds it."""

    def __init__(self, job: Fit, run: Run[SupervisedConfig] | None) -> None:
        self._job, self._run, self.step = job, run, 0
        self._parameters = [parameter for group in job.optimizer.param_groups for parameter in group["params"]]
        self._best, self.best_weights, self.measures = math.inf, dict[str, Tensor](), dict[str, float]()
        self._data = "" if run is None else _digest_of(run.config.data)
        if run is not None and run.state is not None:
            self._check_data(run, run.state)
            self._restore(run.state)
        elif job.keeps_best:
            self._keep_if_best(job.validate())
        if run is not None:
            run.add_table("metrics", (*job.columns, "learning_rate"))
            run.add_table("timing", ("wall_s",))
        self._saved = time.monotonic()

    def update(self, rows: Tensor, rate: float) -> dict[str, float]:
        """One gradient step; returns the losses and the rate."""
        for group in self._job.optimizer.param_groups:
            group["lr"] = rate
        losses = self._job.losses(rows)
        self._job.optimizer.zero_grad(set_to_none=True)
        losses["loss"].backward()  # type: ignore[no-untyped-call]
        if self._job.gradient_norm is not None:
            nn.utils.clip_grad_norm_(self._parameters, self._job.gradient_norm)
        self._job.optimizer.step()
        self.step += 1
        return {name: value.item() for name, value in losses.items()} | {"learning_rate": rate}

    def judge(self) -> dict[str, float]:
        """Validates the network, and keeps its weights if they are the best."""
        self.measures = dict(self._job.validate())
        self._job.rate.validated(self.step, self._keep_if_best(self.measures))
        return self.measures

    def log(self, row: Mapping[str, float], judged: bool) -> None:
        """Adds a row to metrics.csv if it is due, and writes a checkpoint if that is."""
        if self._run is None:
            return
        if judged or self.step % LOG_EVERY == 0:
            self._run.log("metrics", self.step, row)
            self._run.log("timing", self.step, {"wall_s": self._run.wall_s})
        if time.monotonic() - self._saved >= self._run.config.checkpoint_s:
            self.save()

    def save(self) -> None:
        """Writes a checkpoint."""
        if self._run is not None:
            state = {"network": self._job.network.state_dict(), "optimizer": self._job.optimizer.state_dict()}
            best = {
                "best": self._best,
                "best_weights": self.best_weights,
                "measures": self.measures,
                "rate": self._job.rate.state(),
            }
            self._run.save(self.step, state | best | {"random": random_state(), "data_sha256": self._data})
            self._saved = time.monotonic()

    def _check_data(self, run: Run[SupervisedConfig], state: Mapping[str, Any]) -> None:
        expected = state.get("data_sha256", self._data)  # older checkpoints have none
        if expected != self._data:
            raise InvalidInputError(
                f"the run in '{run.folder}' was started with data of the digest {expected[:12]}, got {self._data[:12]} "
                f"in '{run.config.data}'; continue with the former data, or choose another --out"
            )

    def _restore(self, state: Mapping[str, Any]) -> None:
        self.step, self.measures = state["steps"], state["measures"]
        self._best, self.best_weights = state["best"], state["best_weights"]
        self._job.network.load_state_dict(state["network"])
        self._job.optimizer.load_state_dict(state["optimizer"])
        self._job.rate.restore(state["rate"])
        restore_random_state(state["random"])

    def _keep_if_best(self, measures: Mapping[str, float]) -> bool:
        """Whether these measures are the best so far; then the weights are kept."""
        measure = next(iter(measures.values()), math.inf)
        if better := measure < self._best:
            self._best = measure
            if self._job.keeps_best:
                self.best_weights = copy.deepcopy(self._job.network.state_dict())
        return better


def _digest_of(data: Path) -> str:
    """Digest of a data set: of its splits, or, as in the card, of all of it if it has none."""
    splits = [digest(data / split) for split in SPLITS if (data / split).is_dir()]
    return hashlib.sha256("".join(splits).encode()).hexdigest() if splits else digest(data)
