"""Settings that every training run has, with their units."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from dohyo.sumo_networks.config import Config

Positive = Annotated[int, Field(gt=0)]
Share = Annotated[float, Field(ge=0, le=1)]


Merit = Literal["return", "success"]


class BaseRunConfig(Config):
    """Settings of every training run, on a task or a data set.

    Attributes:
        seed: Of weights, exploration, batches and training episodes.
        device: Of torch, such as "cpu" or "cuda"; "auto" takes cuda if available.
        tier: Scale of the result: 1 as large as its source's, 2 reduced, 3 a trial.
        tensorboard: Write TensorBoard events beside metrics.csv.
    """

    seed: Annotated[int, Field(ge=0, lt=2**31)] = 0
    device: str = "auto"
    tier: Literal[1, 2, 3] = 3
    tensorboard: bool = True


class RunConfig(BaseRunConfig):
    """Settings of every training run on a task.

    Attributes:
        steps: Environment steps; the run ends with the round that reaches them.
        processes: Environments, one process each; 0: all environments in this process.
        environments: Environments without processes.
        begin_after: Steps that an environment in a process sits out before its next episode, while its simulation
            starts and the others act; 0: all wait for it.
        evaluate_every: Environment steps between two evaluations on the held-out episodes.
        checkpoint_every: Environment steps between two checkpoints, which cut the running episodes.
        best_by: What makes an evaluation's policy the best: its return, or its success and, where that is equal, its
            return. A reward that also pays for standing ranks policies that reach no goal above those that do.
    """

    steps: Positive = 100_000
    processes: Annotated[int, Field(ge=0, le=64)] = 1
    environments: Positive = 1
    begin_after: Annotated[int, Field(ge=0)] = 0
    evaluate_every: Positive = 20_000
    checkpoint_every: Positive = 20_000
    best_by: Merit = "return"
