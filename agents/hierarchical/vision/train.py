"""Training of the autoencoder: configuration, loss and loop, from top to bottom.

    dohyo dataset semantic --out data/semantic
    dohyo train semantic --config agents/hierarchical/vision/checkpoints/semantic.toml [--resume]

The loop, checkpoints and resumption are those of `learning/supervised.py`.

Source: Albilani 2023, section 6.2.1; the variational loss is Kingma and Welling's, with a weight on its second term.
"""

from __future__ import annotations

from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import torch
from pydantic import Field
from safetensors.torch import save
from torch import Tensor
from torch.nn.functional import cross_entropy, one_hot, smooth_l1_loss

from dohyo.agents.hierarchical.state.nearby import EVENT_M, IMPACT_M
from dohyo.agents.hierarchical.vision.classes import CLASSES, OF_LABEL
from dohyo.agents.hierarchical.vision.dataset import Pictures, load_split
from dohyo.agents.hierarchical.vision.network import Autoencoder
from dohyo.agents.learning.files.report import Report
from dohyo.agents.learning.runs.run import Run
from dohyo.agents.learning.runs.supervised import FREE, Cosine, Fit, SupervisedConfig, fit, shuffled
from dohyo.agents.learning.runs.trainer import Trainer, TrainRequest
from dohyo.agents.perception.vae import divergence
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.files import write_atomically

LOSSES = ("loss", "pixels", "divergence", "distances", "signal")
MEASURES = ("validation_loss", "validation_accuracy", "impact_mae_m", "event_mae_m")
_SHOWN = (1, 2, 3)  # world.LightState RED, YELLOW, GREEN: columns of the head; anything else is 0


class TrainConfig(SupervisedConfig):
    """Settings of the training, on a semantic dataset.

    Attributes:
        epochs: Passes over the training pictures.
        batch: Pictures per update.
        learning_rate: Highest, after the warm-up; then it falls to zero along a cosine.
        warm_up_steps: Steps over which it rises.
        gradient_norm: Upper bound.
        latent: Length of z.
        beta: Weight of the divergence; 1 is the variational bound.
        distance_weight: Weight of the error of both distances, each as a share of 50 m.
        signal_weight: Weight of the error of the light.
        rare: Exponent of a class's share of all pixels, whose inverse weighs its pixels: 0 gives equal weights.
        validation_images: Number used during training, evenly spread.
    """

    epochs: Annotated[int, Field(gt=0)] = 8
    batch: Annotated[int, Field(gt=0)] = 32
    learning_rate: Annotated[float, Field(gt=0)] = 1e-3
    warm_up_steps: Annotated[int, Field(ge=0)] = 100
    gradient_norm: Annotated[float, Field(gt=0)] = 1.0
    latent: Annotated[int, Field(gt=0)] = 400
    beta: Annotated[float, Field(ge=0)] = 1.0
    distance_weight: Annotated[float, Field(ge=0)] = 1.0
    signal_weight: Annotated[float, Field(ge=0)] = 0.1
    rare: Annotated[float, Field(ge=0, le=1)] = 0.5
    validation_images: Annotated[int, Field(gt=0)] = 600
    checkpoint_s: Annotated[float, Field(gt=0)] = 120.0
    device: str = "cpu"


@dataclass(frozen=True, slots=True)
class Batch:
    """Pictures as tensors.

    Attributes:
        classes: (B, 80, 160) uint8 `classes.Seen`.
        distances: (B, 2) to impact and to the next event [50 m].
        signal: (B,) signal of the next junction: 0 none, then red, yellow, green.
    """

    classes: Tensor
    distances: Tensor
    signal: Tensor

    def __len__(self) -> int:
        return len(self.classes)

    @classmethod
    def of(cls, pictures: Pictures) -> Batch:
        """All pictures of a dataset, in memory."""
        distances = np.column_stack([pictures.impact_m / IMPACT_M, pictures.event_m / EVENT_M])
        signal = sum(np.where(pictures.signal == state, column + 1, 0) for column, state in enumerate(_SHOWN))
        return cls(
            torch.from_numpy(OF_LABEL[pictures.pictures]),
            torch.from_numpy(distances.astype(np.float32)),
            torch.from_numpy(np.asarray(signal, dtype=np.int64)),
        )

    def rows(self, index: Tensor, device: str | torch.device = "cpu") -> Batch:
        """Selected pictures."""
        return Batch(self.classes[index].to(device), self.distances[index].to(device), self.signal[index].to(device))

    @property
    def planes(self) -> Tensor:
        """(B, 15, 80, 160) one plane per class."""
        planes = one_hot(self.classes.long(), CLASSES).permute(0, 3, 1, 2)
        return planes.to(torch.float32, memory_format=torch.channels_last)


def losses_of(
    network: Autoencoder, batch: Batch, weights: Tensor, config: TrainConfig, noise: bool = True
) -> dict[str, Tensor]:
    """Parts of the loss, and their weighted sum.

    Args:
        network: The autoencoder.
        batch: Targets.
        weights: (15,) of the classes' pixels.
        config: Gives the weights of the parts.
        noise: Whether the latents are drawn, as in training; else they are their means.

    Returns:
        "pixels": mean cross-entropy of a pixel; "divergence": from the normal distribution, per pixel too, so that both
        add up to the variational bound; "distances", "signal" and "loss".
    """
    logits, mean, log_variance = network(batch.planes, noise)
    told = network.encoder.tell(mean)
    pixels = cross_entropy(logits, batch.classes.long(), weights, reduction="sum") / batch.classes.numel()
    apart = divergence(mean, log_variance) / batch.classes.numel()
    distances = smooth_l1_loss(told[:, :2], batch.distances, beta=0.1)
    signal = cross_entropy(told[:, 2:], batch.signal)
    loss = pixels + config.beta * apart + config.distance_weight * distances + config.signal_weight * signal
    return {"loss": loss, "pixels": pixels, "divergence": apart, "distances": distances, "signal": signal}


def class_weights(classes: Tensor, rare: float) -> Tensor:
    """(15,) weights of pixels by class, whose mean over all pixels is 1; 0 for a class that is never seen.

    Args:
        classes: (N, 80, 160).
        rare: See `TrainConfig`.
    """
    counts = torch.bincount(classes.flatten(), minlength=CLASSES).to(torch.float64)
    share = counts / counts.sum()
    weights = torch.where(counts > 0, share.clamp_min(1e-12) ** -rare, torch.zeros_like(share))
    return (weights / (weights * share).sum()).to(torch.float32)


def train(config: TrainConfig, order: TrainRequest) -> Path:
    """Trains, and writes the encoder.

    Returns:
        The encoder's file, in half precision; the whole autoencoder lies beside it.

    Raises:
        InvalidInputError: There are no data, or the folder holds another training.
        RunStoppedError: The training was stopped, and has written a checkpoint.
    """
    with closing(Run(order.name, order.out, config, order.resume, FREE | {"validation_images"})) as run:
        torch.set_num_threads(1)
        torch.manual_seed(config.seed)
        data, validation = Batch.of(load_split(config.data, "train")), Batch.of(load_split(config.data, "validation"))
        weights = class_weights(data.classes, config.rare).to(run.device)
        network: Autoencoder = Autoencoder(config.latent).to(run.device, memory_format=torch.channels_last)  # type: ignore[call-overload]
        per_epoch = max(len(data) // config.batch, 1)
        steps = config.epochs * per_epoch
        job = Fit(
            network=network,
            optimizer=torch.optim.Adam(network.parameters(), lr=config.learning_rate),
            losses=lambda rows: losses_of(network, data.rows(rows, run.device), weights, config),
            batches=shuffled(len(data), config.batch, config.seed),
            rate=Cosine(config.learning_rate, steps, config.warm_up_steps),
            steps=steps,
            validate=lambda: validate(network, validation, weights, config),
            validate_every=per_epoch,
            gradient_norm=config.gradient_norm,
            columns=(*LOSSES, *MEASURES),
        )
        measures = fit(job, run, lambda step, row: order.report(Report(step, steps, row["loss"], "loss")))
        written = _write(network, run.folder, steps)
        for model in ("semantic", "autoencoder"):
            run.write_card(model, SEMANTIC.summary, steps, measures, config.data)
        return written


def validate(network: Autoencoder, data: Batch, weights: Tensor, config: TrainConfig) -> dict[str, float]:
    """Loss, share of correct pixels, and errors of the distances [m], over part of the validation split."""
    index = torch.linspace(0, len(data) - 1, min(config.validation_images, len(data))).long()
    loss, right, errors = 0.0, 0.0, torch.zeros(2)
    with torch.no_grad():
        for part in torch.split(index, config.batch):
            batch = data.rows(part, weights.device)
            loss += losses_of(network, batch, weights, config, noise=False)["loss"].item() * len(part)
            mean, _ = network.encode(batch.planes)
            right += (network.decode(mean).argmax(dim=1) == batch.classes).float().mean().item() * len(part)
            errors += (network.encoder.tell(mean)[:, :2] - batch.distances).abs().sum(dim=0).cpu()
    impact, event = (errors * torch.tensor([IMPACT_M, EVENT_M]) / len(index)).tolist()
    whole = {"validation_loss": loss / len(index), "validation_accuracy": right / len(index)}
    return whole | {"impact_mae_m": impact, "event_mae_m": event}


def load_autoencoder(path: Path) -> Autoencoder:
    """The whole trained network.

    Raises:
        InvalidInputError: The file is missing, damaged, or of another network.
    """
    from safetensors import SafetensorError
    from safetensors.torch import load_file

    try:
        tensors = load_file(path)
        network = Autoencoder(len(tensors["encoder.mean.bias"]))
        network.load_state_dict(tensors)
    except FileNotFoundError as error:
        raise InvalidInputError(f"no autoencoder '{path}'") from error
    except (OSError, SafetensorError, RuntimeError, KeyError) as error:
        raise InvalidInputError(f"'{path}' is no autoencoder: {str(error).splitlines()[0]}") from error
    return network.eval()


def _write(network: Autoencoder, out: Path, step: int) -> Path:
    """Writes both files; the encoder with its heads, in half precision, is shipped."""
    whole = {name: tensor.cpu().contiguous() for name, tensor in network.state_dict().items()}
    encoder = {name: tensor.cpu().half().contiguous() for name, tensor in network.encoder.state_dict().items()}
    facts = {"steps": str(step)}
    write_atomically(out / "autoencoder.safetensors", save(whole, facts))
    write_atomically(out / "semantic.safetensors", save(encoder, facts))
    return out / "semantic.safetensors"


SEMANTIC = Trainer("autoencoder of semantic pictures, from a semantic data set", TrainConfig, train)
