"""Training of PDM-Hybrid's offset, and of PDM-Open, on a motion data set: configuration, data, loss and loop.

    dohyo dataset motion --out motion --hours 2.8
    dohyo train pdm-offset --set data=motion --out out/pdm-offset/hybrid

The loop, checkpoints and resumption are those of `learning/runs/supervised.py`.
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
from torch import Tensor

from dohyo.agents.learning.files.report import Report, Reporter
from dohyo.agents.learning.policies.export import export
from dohyo.agents.learning.runs.config import Positive
from dohyo.agents.learning.runs.run import Run
from dohyo.agents.learning.runs.supervised import FREE, Cosine, Fit, SupervisedConfig, fit, shuffled
from dohyo.agents.learning.runs.trainer import Trainer, TrainRequest
from dohyo.agents.mcts.predictors.dataset import Sample, load_shard, shards_of
from dohyo.agents.pdm_hybrid.network import PlanNetwork
from dohyo.agents.pdm_hybrid.plans import SPACE, Planner, inputs, make_planner

MEASURES = ("validation_ade_m", "validation_fde_m")
"""Mean distance to where the ego drove, over 8 s and at their end."""
MODEL = "best"


class OffsetConfig(SupervisedConfig):
    """Settings of the training.

    Attributes:
        planned: Whether the network sees PDM-Closed's plan and corrects it (PDM-Hybrid), or neither (PDM-Open).
        steps: Updates.
        batch: Samples per update.
        learning_rate: Highest; it falls to zero along a cosine.
        weight_decay: Of AdamW.
        heading_m: Metres that an error of one radian counts for.
        validate_every: Steps.
    """

    planned: bool = True
    steps: Positive = 12_000
    batch: Positive = 64
    learning_rate: Annotated[float, Field(gt=0)] = 3e-4
    weight_decay: Annotated[float, Field(ge=0)] = 1e-4
    heading_m: Annotated[float, Field(ge=0)] = 2.0
    validate_every: Positive = 500


@dataclass(frozen=True, slots=True)
class Driven:
    """Samples as tensors.

    Attributes:
        inputs: See `plans.inputs`, with N in front.
        future: (N, 16, 3) where the ego drove: x, y [m], heading [rad].
    """

    inputs: dict[str, Tensor]
    future: Tensor

    def rows(self, index: Tensor) -> Driven:
        """Selected samples."""
        return Driven({name: tensor[index] for name, tensor in self.inputs.items()}, self.future[index])


def samples_of(shard: Path) -> list[Sample]:
    """Samples of an episode whose ego drives for 8 s.

    Raises:
        InvalidInputError: See `load_shard`.
    """
    return [sample for sample in load_shard(shard) if sample.ego_future_valid.all()]


def driven(samples: list[Sample], planner: Planner) -> Driven:
    """Samples with the planner's plans in them."""
    seen = [inputs(sample.scene, planner.plan_in(sample.scene)) for sample in samples]
    columns = {name: torch.from_numpy(np.stack([one[name] for one in seen])) for name in SPACE.spaces}
    return Driven(columns, torch.from_numpy(np.stack([sample.ego_future for sample in samples])))


def displacement(poses: Tensor, batch: Driven) -> Tensor:
    """(N, 16) distances to where the ego drove, m."""
    distance: Tensor = torch.linalg.vector_norm(poses[..., :2] - batch.future[..., :2], dim=-1)
    return distance


def loss_of(poses: Tensor, batch: Driven, heading_m: float) -> Tensor:
    """Mean absolute error of the places, and `heading_m` times 1 - cosine of the headings', m."""
    place = (poses[..., :2] - batch.future[..., :2]).abs().sum(dim=-1)
    turn = 1.0 - torch.cos(poses[..., 2] - batch.future[..., 2])
    loss: Tensor = (place + heading_m * turn).mean()
    return loss


def train(config: OffsetConfig, order: TrainRequest) -> Path:
    """Trains, and writes the network with the best validation.

    Returns:
        The ONNX file.

    Raises:
        InvalidInputError: There are no data, or the folder holds another training.
        RunStoppedError: The training was stopped, and has written a checkpoint.
    """
    with closing(Run(order.name, order.out, config, order.resume, FREE)) as run:
        network, measures = _trained(config, run, order.report)
        out = run.folder / MODEL
        export(network, SPACE, out, {"steps": str(config.steps)})
        run.write_card(MODEL, OFFSET.summary, config.steps, measures, config.data)
    return out.with_suffix(".onnx")


def _trained(config: OffsetConfig, run: Run[OffsetConfig], report: Reporter) -> tuple[PlanNetwork, Mapping[str, float]]:
    torch.set_num_threads(1)
    torch.manual_seed(config.seed)
    planner = make_planner()
    data, validation = (
        driven([sample for shard in shards_of(config.data, split) for sample in samples_of(shard)], planner)
        for split in ("train", "validation")
    )
    network = PlanNetwork(config.planned)

    def losses(rows: Tensor) -> dict[str, Tensor]:
        batch = data.rows(rows)
        return {"loss": loss_of(network(batch.inputs), batch, config.heading_m)}

    @torch.no_grad()
    def validate() -> dict[str, float]:
        found = displacement(network(validation.inputs), validation)
        return dict(zip(MEASURES, (float(found.mean()), float(found[:, -1].mean())), strict=True))

    job = Fit(
        network=network,
        optimizer=torch.optim.AdamW(network.parameters(), lr=config.learning_rate, weight_decay=config.weight_decay),
        losses=losses,
        batches=shuffled(len(data.future), config.batch, config.seed),
        rate=Cosine(config.learning_rate, config.steps),
        steps=config.steps,
        validate=validate,
        validate_every=config.validate_every,
        keeps_best=True,
        columns=("loss", *MEASURES),
    )
    fit(job, run, lambda step, row: report(Report(step, config.steps, row["loss"], "loss [m]")))
    return network, validate()


OFFSET = Trainer("PDM-Hybrid's offset to PDM-Closed's plan, from a motion data set", OffsetConfig, train)
