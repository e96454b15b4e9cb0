"""Training of the encoder: configuration, loss and loop, from top to bottom.

    dohyo dataset affordances --out data/affordances
    dohyo train affordances --config agents/gri/vision/checkpoints/affordances.toml --out out/vision/affordances

The result is both encoders without decoder and heads, as one ONNX model. `encoder` names what they learned, for the
comparison of encoders: segmentation and heads, classification alone, or nothing.

Source: Chekroun 2024, section 4.4.2.1. The weights of the losses are ours.
"""

from __future__ import annotations

from contextlib import closing
from pathlib import Path
from typing import Annotated, Final, Literal

import torch
from pydantic import Field
from safetensors import SafetensorError
from safetensors.torch import load_file, save
from torch import Tensor
from torch.nn.functional import cross_entropy, smooth_l1_loss

from dohyo.agents.gri.vision.cameras import CAMERAS, SIDE_PX
from dohyo.agents.gri.vision.labels import LIGHT_M
from dohyo.agents.gri.vision.moments import Moments
from dohyo.agents.gri.vision.network import Frozen, Predictions, VisualSystem
from dohyo.agents.hierarchical.vision.train import class_weights
from dohyo.agents.learning.files.report import Report
from dohyo.agents.learning.policies.joining import exported
from dohyo.agents.learning.runs.run import Run
from dohyo.agents.learning.runs.supervised import FREE, Cosine, Fit, SupervisedConfig, fit, shuffled
from dohyo.agents.learning.runs.trainer import Trainer, TrainRequest
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.files import write_atomically

EncoderName = Literal["affordances", "classification", "untrained"]
CLASSIFIED: Final = ("road", "light", "colour")
REGRESSED: Final = ("distance", "angle", "offset")
LOSSES: Final = ("segmentation", *CLASSIFIED, *REGRESSED)
INPUT, OUTPUT = "pictures", "features"
WHOLE: Final = "whole.safetensors"
"""Encoder, decoder and heads, for `evaluate`."""
SMALL: Final = 0.1
"""Errors of distance [40 m], angle [rad] and offset [m] above it count linearly."""
LEAST_DEVIATION: Final = 1e-3


class TrainConfig(SupervisedConfig):
    """Settings of the training, on a data set of affordances.

    Attributes:
        encoder: What it learns: segmentation and all heads; on both encoders the classifying heads alone; nothing.
        epochs: Passes over the training moments.
        batch: Moments per update.
        learning_rate: Highest, after the warm-up; then it falls to zero along a cosine.
        warm_up_steps: Steps over which it rises.
        gradient_norm: Upper bound.
        regression: Weight of the errors of distance, angle and offset.
        rare: Exponent of a class's share of all pixels, whose inverse weighs its pixels: 0 gives equal weights.
    """

    encoder: EncoderName = "affordances"
    epochs: Annotated[int, Field(gt=0)] = 8
    batch: Annotated[int, Field(gt=0)] = 32
    learning_rate: Annotated[float, Field(gt=0)] = 1e-3
    warm_up_steps: Annotated[int, Field(ge=0)] = 50
    gradient_norm: Annotated[float, Field(gt=0)] = 1.0
    regression: Annotated[float, Field(ge=0)] = 5.0
    rare: Annotated[float, Field(ge=0, le=1)] = 0.5
    device: str = "cpu"


def losses_of(
    network: VisualSystem, batch: Moments, weights: Tensor, config: TrainConfig, cameras: Tensor | None = None
) -> dict[str, Tensor]:
    """The weighted sum "loss", and its parts by `LOSSES`; what the encoder does not learn is 0.

    Args:
        network: Encoder, decoder and heads.
        batch: Pictures and targets.
        weights: (15,) of the classes' pixels.
        config: Names what is learned.
        cameras: (B,) the camera of each moment whose picture is segmented; None: all three are.
    """
    parts = dict.fromkeys(LOSSES, torch.zeros((), device=batch.pictures.device))
    if config.encoder == "classification":
        told, scene = network.predict(batch.pictures), network.predict_from_scene(batch.pictures)
        mine, other = _classification(told, batch), _classification(scene, batch)
        parts |= {name: mine[name] + other[name] for name in CLASSIFIED}
    elif config.encoder == "affordances":
        told = network.predict(batch.pictures)
        parts |= {"segmentation": _segmentation(network, batch, weights, cameras), **_classification(told, batch)}
        parts |= {"distance": _distance(told, batch), **_place(told, batch)}
    scale = dict.fromkeys(REGRESSED, config.regression)
    return {"loss": torch.stack([scale.get(name, 1.0) * part for name, part in parts.items()]).sum(), **parts}


def _segmentation(network: VisualSystem, batch: Moments, weights: Tensor, cameras: Tensor | None) -> Tensor:
    """Mean error of a pixel."""
    rows = torch.arange(len(batch), device=batch.pictures.device)
    seen, true = batch.pictures.flatten(0, 1), batch.classes.flatten(0, 1)
    if cameras is not None:
        seen, true = batch.pictures[rows, cameras], batch.classes[rows, cameras]
    return cross_entropy(network.segment(seen), true.long(), weights, reduction="sum") / true.numel()


def _classification(told: Predictions, batch: Moments) -> dict[str, Tensor]:
    """Errors of the classifying heads; the colour counts where there is a light."""
    lit = batch.light > 0
    colour = cross_entropy(told.colour[lit], batch.light[lit] - 1) if lit.any() else told.colour.sum() * 0.0
    return {
        "road": cross_entropy(told.road, batch.junction),
        "light": cross_entropy(told.light, lit.long()),
        "colour": colour,
    }


def _distance(told: Predictions, batch: Moments) -> Tensor:
    """Error of the distance where there is a light."""
    lit = batch.light > 0
    if not lit.any():
        return told.distance.sum() * 0.0
    return smooth_l1_loss(told.distance[lit], batch.distance_m[lit] / LIGHT_M, beta=SMALL)


def _place(told: Predictions, batch: Moments) -> dict[str, Tensor]:
    """Errors of the angle to the lane, and of the distance from its middle."""
    return {
        "angle": smooth_l1_loss(told.angle, batch.angle_rad, beta=SMALL),
        "offset": smooth_l1_loss(told.offset, batch.offset_m, beta=SMALL),
    }


def train(config: TrainConfig, order: TrainRequest) -> Path:
    """Trains, and writes the frozen encoder.

    Returns:
        The encoder's file; the whole network lies beside it.

    Raises:
        InvalidInputError: There are no data, or the folder holds another training.
        RunStoppedError: The training was stopped, and has written a checkpoint.
    """
    with closing(Run(order.name, order.out, config, order.resume, FREE)) as run:
        torch.set_num_threads(1)
        torch.manual_seed(config.seed)
        data, validation = Moments.load(config.data, "train"), Moments.load(config.data, "validation")
        weights = class_weights(data.classes, config.rare).to(run.device)
        network = VisualSystem().to(run.device)
        per_epoch = max(len(data) // config.batch, 1)
        steps = 0 if config.encoder == "untrained" else config.epochs * per_epoch
        job = Fit(
            network=network,
            optimizer=torch.optim.Adam(network.parameters(), lr=config.learning_rate),
            losses=lambda rows: losses_of(
                network, data.rows(rows, run.device), weights, config, drawn_cameras(len(rows))
            ),
            batches=shuffled(len(data), config.batch, config.seed),
            rate=Cosine(config.learning_rate, max(steps, 1), config.warm_up_steps),
            steps=steps,
            validate=lambda: validate(network, validation, weights, config),
            validate_every=per_epoch,
            gradient_norm=config.gradient_norm,
            columns=("loss", *LOSSES, *(f"validation_{name}" for name in ("loss", *LOSSES))),
        )
        measures = fit(job, run, lambda step, row: order.report(Report(step, steps, row["loss"], "loss")))
        written = run.folder / f"{config.encoder}.onnx"
        write_atomically(run.folder / WHOLE, save({name: one.cpu() for name, one in network.state_dict().items()}))
        write_atomically(written, frozen_model(network, data, config.batch))
        run.write_card(config.encoder, AFFORDANCES.summary, steps, measures, config.data / "train")
        return written


def drawn_cameras(moments: int) -> Tensor:
    """(B,) camera of each moment, from torch's generator: a pass over the data segments a third of the pictures."""
    return torch.randint(len(CAMERAS), (moments,))


def validate(network: VisualSystem, data: Moments, weights: Tensor, config: TrainConfig) -> dict[str, float]:
    """Means of all losses over the validation split."""
    sums = dict.fromkeys(("loss", *LOSSES), 0.0)
    with torch.inference_mode():
        for part in torch.split(torch.arange(len(data)), config.batch):
            found = losses_of(network, data.rows(part, weights.device), weights, config)
            sums = {name: total + found[name].item() * len(part) for name, total in sums.items()}
    return {f"validation_{name}": total / len(data) for name, total in sums.items()}


def frozen_model(network: VisualSystem, data: Moments, batch: int) -> bytes:
    """The shipped ONNX model: `INPUT` (1, 3, 3, 64, 64) uint8 to `OUTPUT` (1, 1024), standardised over the data."""
    encoder = network.encoder.cpu().eval()
    with torch.inference_mode():
        found = torch.cat([encoder(part) for part in torch.split(data.pictures, batch)])
    moments = found.mean(0).clone(), found.std(0).clamp_min(LEAST_DEVIATION).clone()
    example = torch.zeros(1, len(CAMERAS), 3, SIDE_PX, SIDE_PX, dtype=torch.uint8)
    return bytes(exported(Frozen(encoder, *moments), {INPUT: example}, [OUTPUT]).SerializeToString())


def load_system(path: Path) -> VisualSystem:
    """The whole trained network.

    Raises:
        InvalidInputError: The file is missing, damaged, or of another network.
    """
    network = VisualSystem()
    try:
        network.load_state_dict(load_file(path))
    except (OSError, SafetensorError, RuntimeError) as error:
        raise InvalidInputError(f"'{path}' is no trained encoder: {str(error).splitlines()[0]}") from error
    return network.eval()


AFFORDANCES = Trainer("GRIAD's encoder of three cameras, from a data set of affordances", TrainConfig, train)
