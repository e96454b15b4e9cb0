"""Trainer of the motion predictor, which learns from a data set in its own loop."""

from __future__ import annotations

from pathlib import Path

from dohyo.agents.learning.registry import Trainer, TrainRequest
from dohyo.agents.learning.report import Report
from dohyo.agents.mcts.predictors import export, train
from dohyo.agents.mcts.predictors.train import TrainConfig


def train_predictor(config: TrainConfig, order: TrainRequest) -> Path:
    """Trains the motion predictor, and exports it to ONNX, too."""
    config = config.model_copy(update={"out": order.out})
    trained = train.train(
        config, order.resume, lambda step, loss: order.report(Report(step, config.steps, loss, "loss [m]"))
    )
    export.export(export.load_network(trained), trained.with_suffix(".onnx"))
    return trained.with_suffix(".onnx")


PREDICTOR = Trainer("motion predictor of MBAPPE, from a motion data set", TrainConfig, train_predictor)
