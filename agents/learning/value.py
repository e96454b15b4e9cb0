"""Trainer of MBAPPE's value network, which learns from a motion data set in its own loop."""

from __future__ import annotations

from pathlib import Path

from dohyo.agents.learning.registry import Trainer, TrainRequest
from dohyo.agents.learning.report import Report
from dohyo.agents.mcts.value import train
from dohyo.agents.mcts.value.train import ValueConfig


def train_value(config: ValueConfig, order: TrainRequest) -> Path:
    """Searches the scenes of the data set, and trains the network on the results."""
    config = config.model_copy(update={"out": order.out})
    return train.train(config, order.resume, lambda step, loss: order.report(Report(step, config.steps, loss, "loss")))


VALUE = Trainer("value network of MBAPPE, from searches of a motion data set's scenes", ValueConfig, train_value)
