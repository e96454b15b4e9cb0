"""Training of the autoencoder: configuration, loss and loop, from top to bottom.

    dohyo dataset semantic --out data/semantic
    dohyo train semantic --config agents/hierarchical/vision/checkpoints/semantic.toml [--resume]

The order of the pictures follows from the seed and the epoch, the learning rate from the step, and a checkpoint holds
network, optimiser and generator: a training that was killed and resumed ends with the same weights.

Source: Albilani 2023, section 6.2.1; the variational loss is Kingma and Welling's, with a weight on its second term.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import torch
from pydantic import Field
from safetensors.torch import save
from torch import Tensor
from torch.nn.functional import cross_entropy, one_hot, smooth_l1_loss

from dohyo.agents.hierarchical.nearby import EVENT_M, IMPACT_M
from dohyo.agents.hierarchical.vision.classes import CLASSES, OF_LABEL
from dohyo.agents.hierarchical.vision.dataset import Pictures, load_split
from dohyo.agents.hierarchical.vision.network import Autoencoder
from dohyo.agents.learning.checkpoint import load_checkpoint, random_state, restore_random_state, save_checkpoint
from dohyo.agents.learning.metrics import Table
from dohyo.agents.learning.registry import Trainer, TrainRequest
from dohyo.agents.learning.report import Report
from dohyo.agents.learning.run import RunStoppedError, Stop
from dohyo.agents.learning.settings import differences
from dohyo.agents.perception.vae import divergence
from dohyo.sumo_networks.config import Config
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.files import write_atomically

COLUMNS = (
    *("loss", "pixels", "divergence", "distances", "signal"),
    *("validation_loss", "validation_accuracy", "impact_mae_m", "event_mae_m", "learning_rate", "wall_s"),
)
LOG_EVERY = 20
FREE = frozenset({"out", "checkpoint_s", "validation_images"})
"""Settings that decide no weight."""
_SHOWN = (1, 2, 3)  # world.LightState RED, YELLOW, GREEN: columns of the head; anything else is 0


class TrainConfig(Config):
    """Settings of the training.

    Attributes:
        data: Folder of the semantic dataset.
        out: Folder that gets the checkpoints, log.csv, autoencoder.safetensors and semantic.safetensors.
        seed: Decides the first weights, the order of the pictures and the latents' noise.
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
        checkpoint_s: Wall-clock time between two checkpoints, s.
        device: Of torch.
    """

    data: Path
    out: Path = Path("runs/semantic")
    seed: Annotated[int, Field(ge=0)] = 0
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

    def rows(self, index: Tensor, device: str = "cpu") -> Batch:
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


def train(
    config: TrainConfig, resume: bool = False, progress: Callable[[int, int, float], None] = lambda step, of, loss: None
) -> Path:
    """Trains, and writes the encoder.

    Args:
        config: Settings.
        resume: Continue from the newest checkpoint in the output folder.
        progress: Called with every step, how many there are, and the loss.

    Returns:
        The encoder's file, in half precision; the whole autoencoder lies beside it.

    Raises:
        InvalidInputError: There are no data, or no checkpoint of the same configuration.
        RunStoppedError: The training was stopped, and has written a checkpoint.
    """
    state = _claim(config, resume)
    torch.set_num_threads(1)
    torch.manual_seed(config.seed)
    data, validation = Batch.of(load_split(config.data, "train")), Batch.of(load_split(config.data, "validation"))
    weights = class_weights(data.classes, config.rare).to(config.device)
    training = _Training(config, state)
    per_epoch = max(len(data) // config.batch, 1)
    steps = config.epochs * per_epoch
    with Stop().listening() as stop:
        while training.step < steps:
            step = training.step
            batch = data.rows(batch_indices(step, len(data), config), config.device)
            row = training.update(batch, weights, learning_rate(step, steps, config))
            step += 1
            progress(step, steps, row["loss"])
            if step % per_epoch == 0:
                row |= validate(training.network, validation, weights, config)
            if step % LOG_EVERY == 0 or step % per_epoch == 0:
                training.table.add(step, row | {"wall_s": training.wall_s})
            if training.checkpoint_due or step == steps or stop.requested:
                training.save()
            if stop.requested and step < steps:
                raise RunStoppedError(f"stopped at step {step} of {steps}")
    training.table.close()
    return _write(training.network, config.out, steps)


class _Training:
    """State of a training, as a checkpoint holds it."""

    def __init__(self, config: TrainConfig, state: dict[str, Any] | None) -> None:
        self.config, self.step = config, 0
        network = Autoencoder(config.latent).to(config.device, memory_format=torch.channels_last)  # type: ignore[call-overload]
        self.network: Autoencoder = network
        self.optimiser = torch.optim.Adam(network.parameters(), lr=config.learning_rate)
        self._began = self._saved = time.monotonic()
        if state is not None:
            self.step = int(state["step"])
            self._began -= float(state["wall_s"])
            network.load_state_dict(state["network"])
            self.optimiser.load_state_dict(state["optimiser"])
            restore_random_state(state["random"])
        self.table = Table(config.out / "log.csv", COLUMNS, self.step if state is not None else None)

    @property
    def wall_s(self) -> float:
        """Time spent, over all sessions, s."""
        return time.monotonic() - self._began

    @property
    def checkpoint_due(self) -> bool:
        """Whether the last checkpoint is too old."""
        return time.monotonic() - self._saved >= self.config.checkpoint_s

    def update(self, batch: Batch, weights: Tensor, rate: float) -> dict[str, float]:
        """One step; returns the parts of its loss, and the learning rate."""
        for group in self.optimiser.param_groups:
            group["lr"] = rate
        parts = losses_of(self.network, batch, weights, self.config)
        self.optimiser.zero_grad(set_to_none=True)
        parts["loss"].backward()  # type: ignore[no-untyped-call]
        torch.nn.utils.clip_grad_norm_(self.network.parameters(), self.config.gradient_norm)
        self.optimiser.step()
        self.step += 1
        return {name: part.item() for name, part in parts.items()} | {"learning_rate": rate}

    def save(self) -> None:
        """Writes a checkpoint; the rows before it are on the disk first."""
        self.table.sync()
        facts = {"step": self.step, "config": self.config.model_dump(mode="json"), "wall_s": self.wall_s}
        parts = {"network": self.network.state_dict(), "optimiser": self.optimiser.state_dict()}
        save_checkpoint(self.config.out, self.step, facts | parts | {"random": random_state()})
        self._saved = time.monotonic()


def learning_rate(step: int, steps: int, config: TrainConfig) -> float:
    """Learning rate: rises, then falls to zero along a cosine."""
    if step < config.warm_up_steps:
        return config.learning_rate * (step + 1) / config.warm_up_steps
    share = (step - config.warm_up_steps) / max(steps - config.warm_up_steps, 1)
    return 0.5 * config.learning_rate * (1.0 + math.cos(math.pi * share))


def batch_indices(step: int, size: int, config: TrainConfig) -> Tensor:
    """Pictures of a step: every epoch shuffles them, and leaves out an incomplete batch."""
    batch = min(config.batch, size)
    epoch, place = divmod(step, max(size // batch, 1))
    order = np.random.default_rng([config.seed, epoch]).permutation(size)
    return torch.from_numpy(order[place * batch : (place + 1) * batch])


def validate(network: Autoencoder, data: Batch, weights: Tensor, config: TrainConfig) -> dict[str, float]:
    """Loss, share of correct pixels, and errors of the distances [m], over part of the validation split."""
    index = torch.linspace(0, len(data) - 1, min(config.validation_images, len(data))).long()
    loss, right, errors = 0.0, 0.0, torch.zeros(2)
    with torch.no_grad():
        for part in torch.split(index, config.batch):
            batch = data.rows(part, config.device)
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


def train_semantic(config: TrainConfig, order: TrainRequest) -> Path:
    """Trains the autoencoder for `dohyo train semantic`."""
    config = config.model_copy(update={"out": order.out})
    return train(config, order.resume, lambda step, of, loss: order.report(Report(step, of, loss, "loss")))


def _claim(config: TrainConfig, resume: bool) -> dict[str, Any] | None:
    """Checkpoint to continue from; None at the begin."""
    there = sorted(config.out.glob("checkpoint-*.pt")) if config.out.is_dir() else []
    if there and not resume:
        raise InvalidInputError(f"'{config.out}' holds a training; continue with --resume, or choose another folder")
    if resume and not there:
        raise InvalidInputError(f"no checkpoint in '{config.out}' to continue")
    config.out.mkdir(parents=True, exist_ok=True)
    state = load_checkpoint(config.out) if resume else None
    if state is not None:
        begun = TrainConfig.model_validate(state["config"])
        if changed := differences(begun, config, FREE):
            raise InvalidInputError(f"the training in '{config.out}' was started with {'; '.join(changed)}")
    return state


def _write(network: Autoencoder, out: Path, step: int) -> Path:
    """Writes both files; the encoder with its heads, in half precision, is shipped."""
    whole = {name: tensor.cpu().contiguous() for name, tensor in network.state_dict().items()}
    encoder = {name: tensor.cpu().half().contiguous() for name, tensor in network.encoder.state_dict().items()}
    facts = {"steps": str(step)}
    write_atomically(out / "autoencoder.safetensors", save(whole, facts))
    write_atomically(out / "semantic.safetensors", save(encoder, facts))
    return out / "semantic.safetensors"


SEMANTIC = Trainer("autoencoder of semantic pictures, from a semantic data set", TrainConfig, train_semantic)
