"""Training of the learned predictor: configuration, data, loss and loop, from top to bottom.

    dohyo train predictor --config agents/mcts/predictors/checkpoints/motion.toml [--resume]

The loop, checkpoints and resumption are those of `learning/supervised.py`.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import torch
from pydantic import Field
from safetensors.torch import save
from torch import Tensor
from torch.nn.functional import smooth_l1_loss

from dohyo.agents.learning.files.checkpoint import newest_step
from dohyo.agents.learning.files.report import Report, Reporter
from dohyo.agents.learning.files.settings import read_settings
from dohyo.agents.learning.runs.run import Run, stored_config
from dohyo.agents.learning.runs.supervised import FREE, Cosine, Fit, SupervisedConfig, fit, shuffled
from dohyo.agents.learning.runs.trainer import Trainer, TrainRequest
from dohyo.agents.mcts.predictors import export
from dohyo.agents.mcts.predictors.dataset import FUTURE_STEPS, Sample, load_shard, shards_of
from dohyo.agents.mcts.predictors.features import AGENTS, SHAPES, features, padded
from dohyo.agents.mcts.predictors.network import MotionNetwork
from dohyo.sumo_networks.files import write_atomically

MEASURES = ("validation_ade_m", "validation_fde_m")


class TrainConfig(SupervisedConfig):
    """Settings of the training, on a motion dataset.

    Attributes:
        steps: Updates.
        batch: Samples per update.
        learning_rate: Highest, after the warm-up.
        warm_up_steps: Steps over which it rises.
        decay_steps: Last steps, over which it falls to zero along a cosine; None: all after the warm-up. A
            training that has not come so far may be resumed with another number of `steps`.
        weight_decay: Of AdamW.
        gradient_norm: Upper bound.
        ego_weight: Weight of the ego, relative to a neighbour.
        heading_m: Metres that an error of one radian counts for.
        validate_every: Steps.
        validation_samples: Samples of the validation split used during training, evenly spread.
    """

    steps: Annotated[int, Field(gt=0)] = 2000
    batch: Annotated[int, Field(gt=0)] = 32
    learning_rate: Annotated[float, Field(gt=0)] = 1e-3
    warm_up_steps: Annotated[int, Field(ge=0)] = 100
    decay_steps: Annotated[int, Field(gt=0)] | None = None
    weight_decay: Annotated[float, Field(ge=0)] = 1e-4
    gradient_norm: Annotated[float, Field(gt=0)] = 1.0
    ego_weight: Annotated[float, Field(gt=0)] = 3.0
    heading_m: Annotated[float, Field(ge=0)] = 2.0
    validate_every: Annotated[int, Field(gt=0)] = 250
    validation_samples: Annotated[int, Field(gt=0)] = 500
    device: str = "cpu"

    @property
    def falls_from(self) -> int:
        """The first step whose learning rate depends on how many there are."""
        return self.warm_up_steps if self.decay_steps is None else max(self.steps - self.decay_steps, 0)

    @property
    def rate(self) -> Cosine:
        """The learning rate over the steps."""
        return Cosine(self.learning_rate, self.steps, self.warm_up_steps, self.falls_from)


@dataclass(frozen=True, slots=True)
class Batch:
    """Samples as tensors.

    Attributes:
        inputs: See `features.SHAPES`, with B in front.
        future: (B, 31, 16, 3) x, y [m], heading [rad]; row 0 is the ego.
        valid: (B, 31, 16) poses that happened and were seen.
    """

    inputs: dict[str, Tensor]
    future: Tensor
    valid: Tensor

    def __len__(self) -> int:
        return len(self.future)

    def rows(self, index: Tensor) -> Batch:
        """Selected samples, without padding that none of them needs."""
        inputs = {name: tensor[index] for name, tensor in self.inputs.items()}
        agents = int(inputs["agents_valid"].sum(dim=1).max())
        lanes = max(int(inputs["lanes_valid"].sum(dim=1).max()), 1)
        for name, tensor in inputs.items():
            inputs[name] = tensor[:, : lanes if name in ("points", "lanes", "lanes_valid") else agents]
        return Batch(inputs, self.future[index, :agents], self.valid[index, :agents])

    def to(self, device: torch.device) -> Batch:
        """Copy on a device."""
        return Batch({k: v.to(device) for k, v in self.inputs.items()}, self.future.to(device), self.valid.to(device))


def load_split(folder: Path, split: str) -> Batch:
    """All samples of a split, in memory."""
    inputs: dict[str, list[np.ndarray]] = {name: [] for name in SHAPES}
    futures, valids = [], []
    for path in shards_of(folder, split):
        for sample in load_shard(path):
            for name, array in padded(features(sample.scene)).items():
                inputs[name].append(array)
            future, valid = targets(sample)
            futures.append(future)
            valids.append(valid)
    return Batch(
        {name: torch.from_numpy(np.stack(arrays)) for name, arrays in inputs.items()},
        torch.from_numpy(np.stack(futures)),
        torch.from_numpy(np.stack(valids)),
    )


def targets(sample: Sample) -> tuple[np.ndarray, np.ndarray]:
    """(31, 16, 3) futures, and (31, 16) whether they were seen, in the rows of `features`."""
    future, valid = np.zeros((AGENTS, FUTURE_STEPS, 3), np.float32), np.zeros((AGENTS, FUTURE_STEPS), np.bool_)
    future[0], valid[0] = sample.ego_future, sample.ego_future_valid
    seen = min(len(sample.actors_future), AGENTS - 1)
    future[1 : seen + 1], valid[1 : seen + 1] = sample.actors_future[:seen], sample.actors_future_valid[:seen]
    return future, valid


def loss_of(poses: Tensor, batch: Batch, config: TrainConfig) -> Tensor:
    """Mean error over all poses that were seen, m: Huber's of the position, and of the heading's chord.

    Args:
        poses: (B, A, 16, 3) predicted.
        batch: The true futures.
        config: Gives the weights.
    """
    place = smooth_l1_loss(poses[..., :2], batch.future[..., :2], reduction="none").sum(dim=-1)
    turn = 1.0 - torch.cos(poses[..., 2] - batch.future[..., 2])
    weight = batch.valid.to(place.dtype)
    weight[:, 0] *= config.ego_weight
    loss: Tensor = ((place + config.heading_m * turn) * weight).sum() / weight.sum().clamp_min(1.0)
    return loss


def displacement(poses: Tensor, batch: Batch) -> tuple[Tensor, Tensor]:
    """Mean displacement over the poses seen, and at 8 s, of every agent seen for 8 s, m."""
    error = torch.linalg.vector_norm(poses[..., :2] - batch.future[..., :2], dim=-1)
    whole = batch.valid.all(dim=-1)
    return error[whole].mean(dim=-1), error[whole][:, -1]


def train(config: TrainConfig, order: TrainRequest) -> Path:
    """Trains, and writes the predictor, as safetensors and as ONNX.

    Returns:
        The ONNX file.

    Raises:
        InvalidInputError: There are no data, or the folder holds another training.
        RunStoppedError: The training was stopped, and has written a checkpoint.
    """
    with closing(Run(order.name, order.out, config, order.resume, _free(config, order))) as run:
        network, measures = _trained(config, run, order.report)
        out = run.folder / "predictor.safetensors"
        weights = {name: tensor.cpu().contiguous() for name, tensor in network.state_dict().items()}
        write_atomically(out, save(weights, {"steps": str(config.steps)}))
        export.export(export.load_network(out), out.with_suffix(".onnx"))
        run.write_card("predictor", PREDICTOR.summary, config.steps, measures, config.data)
    return out.with_suffix(".onnx")


def _trained(config: TrainConfig, run: Run[TrainConfig], report: Reporter) -> tuple[MotionNetwork, Mapping[str, float]]:
    torch.set_num_threads(1)
    torch.manual_seed(config.seed)
    data, validation = load_split(config.data, "train"), load_split(config.data, "validation").to(run.device)
    network = MotionNetwork().to(run.device)

    def losses(rows: Tensor) -> dict[str, Tensor]:
        batch = data.rows(rows).to(run.device)
        return {"loss": loss_of(network(**batch.inputs), batch, config)}

    job = Fit(
        network=network,
        optimizer=torch.optim.AdamW(network.parameters(), lr=config.learning_rate, weight_decay=config.weight_decay),
        losses=losses,
        batches=shuffled(len(data), config.batch, config.seed),
        rate=config.rate,
        steps=config.steps,
        validate=lambda: validate(network, validation, config),
        validate_every=config.validate_every,
        gradient_norm=config.gradient_norm,
        columns=("loss", *MEASURES),
    )
    return network, fit(job, run, lambda step, row: report(Report(step, config.steps, row["loss"], "loss [m]")))


def _free(config: TrainConfig, order: TrainRequest) -> frozenset[str]:
    """Settings that may change: those that decide no weight, and those of the end while no step depends on them."""
    free = FREE | {"validate_every", "validation_samples"}
    stored = stored_config(order.out, order.name) if order.resume else None
    if stored is None or newest_step(order.out) > min(config.falls_from, read_settings(TrainConfig, stored).falls_from):
        return free
    return free | {"steps", "decay_steps"}


def validate(network: MotionNetwork, data: Batch, config: TrainConfig) -> dict[str, float]:
    """Mean and final displacement over part of the validation split, m."""
    index = torch.linspace(0, len(data) - 1, min(config.validation_samples, len(data))).long()
    errors = []
    with torch.no_grad():
        for part in torch.split(index, config.batch):
            batch = data.rows(part)
            errors.append(displacement(network(**batch.inputs), batch))
    mean, final = (torch.cat(parts).mean() for parts in zip(*errors, strict=True))
    return dict(zip(MEASURES, (float(mean), float(final)), strict=True))


PREDICTOR = Trainer("motion predictor of MBAPPE, from a motion data set", TrainConfig, train)
